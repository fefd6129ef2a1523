//! The report of a run: a few lines for people, a JSON file for programs.

use crate::balance::Misfit;
use crate::certificate::Certificate;
use crate::color::Rgb64;
use crate::error::{Warning, in_one_line};
use crate::memory;
use crate::plan::Spent;
use crate::radiosity::Energy;
use crate::solution::{Figures, Solution};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

/// The facts of one run. Times in seconds, energies per channel in watts, defects raw.
#[derive(Serialize)]
pub(super) struct Report {
    pub scene: String,
    pub triangles: usize,
    pub patches: usize,
    /// Edges of the mesh with a triangle on one side only; through them light escapes.
    pub open_edges: usize,
    pub rays: u64,
    pub transport_rays: u64,
    /// `null` where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    pub seconds: Seconds,
    /// The relative residual after each iteration; of shooting, after each thousandth of a round.
    pub residuals: Vec<f64>,
    pub iterations: u64,
    /// The largest |Σ_j F_ij − 1|.
    pub row_sum_defect: f64,
    /// Σ A |Σ_j F_ij − 1| / Σ A.
    pub mean_row_sum_defect: f64,
    /// The largest |A_i F_ij − A_j F_ji| / min(A_i, A_j); `null` where no matrix was stored.
    pub reciprocity_defect: Option<f64>,
    pub energy: EnergyBalance,
    /// How far the light is from the truth, at most; `null` where that is not known.
    pub certificate: Option<Certificate>,
    /// The root mean square of the patches' standard errors, relative to that of their irradiance; `null` where they
    /// are not known.
    pub patch_error: Option<f32>,
    /// (absorbed + on backs + escaped) / (emitted + from the sky) − 1, of the channels' means.
    pub imbalance: f64,
    /// How far that may be off: see [`Misfit`].
    pub misfit: Misfit,
    /// The root mean square of the relative standard errors of the pixels, the largest of all gathered pictures, or else
    /// of those by paths; `null` where there is none.
    pub picture_error: Option<f32>,
    /// That of the first picture; `null` where nothing was drawn.
    pub exposure: Option<f32>,
    /// One per view, where these differ.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exposures: Vec<f32>,
    pub files: Vec<String>,
    #[serde(skip)]
    pub automatic_exposure: bool,
}

#[derive(Serialize, Default)]
pub(super) struct Seconds {
    pub load: f64,
    pub build: f64,
    pub transport: f64,
    pub solve: f64,
    pub render: f64,
    pub total: f64,
}

#[derive(Serialize)]
pub(super) struct EnergyBalance {
    emitted: [f64; 3],
    /// `null` without a sky.
    from_sky: Option<[f64; 3]>,
    absorbed: [f64; 3],
    /// `null` where it is not known apart from what escaped.
    on_backs: Option<[f64; 3]>,
    escaped: [f64; 3],
}

/// A larger share of the power than this should not be missing, or there too often.
const BALANCED: f64 = 0.02;

/// Standard errors within which the balance lies in all but one of a thousand runs, about: patches are many, but few of
/// them may see what absorbs the light.
const EXPLAINED: f64 = 5.0;

/// What rounding and patches that others partly cover may leave of the power.
const COVERED: f64 = 0.002;

impl Seconds {
    /// Before anything is drawn. What is covered is found for the pictures' sake.
    pub(super) fn new(load: Duration, build: Duration, spent: &Spent) -> Seconds {
        Seconds {
            load: load.as_secs_f64(),
            build: build.as_secs_f64(),
            transport: spent.transport.as_secs_f64(),
            solve: spent.solve.as_secs_f64(),
            render: spent.coverage.as_secs_f64(),
            total: 0.0,
        }
    }
}

impl From<Energy> for EnergyBalance {
    fn from(energy: Energy) -> Self {
        EnergyBalance {
            emitted: energy.emitted.to_array(),
            from_sky: (energy.from_sky != Rgb64::ZERO).then(|| energy.from_sky.to_array()),
            absorbed: energy.absorbed.to_array(),
            on_backs: energy.on_backs.map(|power| power.to_array()),
            escaped: energy.escaped.to_array(),
        }
    }
}

impl Report {
    /// The figures of a run with this solution, before anything is drawn. The caller fills in `rays`.
    pub(super) fn new<'p>(
        solution: &Solution,
        seconds: Seconds,
        files: impl IntoIterator<Item = &'p Path>,
    ) -> Report {
        let Figures { residuals, iterations, energy, rays, .. } = &solution.figures;
        Report {
            scene: solution.title.clone(),
            triangles: solution.scene().triangles.len(),
            patches: solution.irradiance().len(),
            open_edges: solution.scene().topology().open_edges(),
            rays: 0,
            transport_rays: *rays,
            peak_memory_bytes: memory::peak(),
            seconds,
            residuals: residuals.clone(),
            iterations: *iterations,
            row_sum_defect: solution.figures.row_sum_defect,
            mean_row_sum_defect: solution.figures.mean_row_sum_defect,
            reciprocity_defect: solution.figures.reciprocity_defect,
            energy: (*energy).into(),
            certificate: solution.figures.certificate,
            patch_error: solution.relative_error(),
            imbalance: energy.imbalance(),
            misfit: solution.figures.misfit,
            picture_error: None,
            exposure: None,
            exposures: Vec::new(),
            files: files.into_iter().map(|path| path.to_string_lossy().into()).collect(),
            automatic_exposure: false,
        }
    }

    pub(super) fn to_json(&self) -> Vec<u8> {
        let mut text = serde_json::to_string_pretty(self).expect("plain numbers and strings");
        text.push('\n');
        text.into_bytes()
    }

    /// Says so if the power does not balance, or balances by chance. What is off is noise, what iterations left, or light
    /// where no patches are.
    pub(super) fn warning(&self) -> Option<Warning> {
        let Misfit { samples, iterations } = self.misfit;
        let off = format!("the power does not balance by {:+.1} %", 100.0 * self.imbalance);
        let error = samples.map(|error| format!("its standard error is {:.1} %", 100.0 * error));
        let explained = samples.unwrap_or(f64::INFINITY) * EXPLAINED + iterations + COVERED;
        let more = "take more samples (--samples, --direct)";
        let text = if iterations > 0.5 * self.imbalance.abs().max(BALANCED) {
            format!(
                "{off}, and iterations left {:.1} %: take more (--tolerance, --iterations)",
                100.0 * iterations
            )
        } else if self.imbalance.abs() > BALANCED {
            let error = error.map_or(String::new(), |error| format!(", {error}"));
            format!("{off}{error}: {more} or smaller patches (--max-edge)")
        } else if samples.is_some_and(|samples| 2.0 * samples > BALANCED) {
            let error = error.unwrap_or_default();
            format!(
                "the power balances by chance, {error}: all light may be off by as much; {more}"
            )
        } else if self.imbalance.abs() > explained {
            let error = error.unwrap_or_default();
            format!("{off}, though {error}: light is lost or counted twice where surfaces overlap")
        } else {
            return None;
        };
        Some(Warning::new(text))
    }

    /// The standard error of the balance, in words.
    fn within(&self) -> String {
        match self.misfit.samples {
            Some(error) => format!(" ± {:.3} %", 100.0 * error),
            None => String::new(),
        }
    }

    /// The few lines that end a run.
    pub(super) fn to_text(&self) -> String {
        let s = &self.seconds;
        let mut text = format!("{}\n", in_one_line(&self.scene));
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "  {name:<13} {value}");
        };
        line("mesh", format!("{} triangles, {} patches", self.triangles, self.patches));
        let solution = match self.residuals.last() {
            Some(residual) => {
                format!("residual {residual:.1e} after {} iterations", self.iterations)
            }
            None => "not iterated".into(),
        };
        line("solution", solution);
        let reciprocity = match self.reciprocity_defect {
            Some(defect) => format!("{defect:.2e}"),
            None => "not measured (no matrix)".into(),
        };
        let open = match self.open_edges {
            0 => String::new(),
            edges => format!(" (the mesh is open at {edges} edges)"),
        };
        line(
            "defects",
            format!(
                "row sum {:.2e} at most, {:.2e} on average{open}; reciprocity {reciprocity}",
                self.row_sum_defect, self.mean_row_sum_defect
            ),
        );
        line("emitted", watts(self.energy.emitted));
        if let Some(power) = self.energy.from_sky {
            line("from the sky", watts(power));
        }
        line("absorbed", watts(self.energy.absorbed));
        if let Some(power) = self.energy.on_backs {
            line("on backs", watts(power));
        }
        line("escaped", watts(self.energy.escaped));
        line("balance", format!("{:+.3} %{}", 100.0 * self.imbalance, self.within()));
        if let Some(Certificate { residual, bound }) = self.certificate {
            let bound = match bound {
                Some(bound) => {
                    format!("the patches' light is off by at most {:.1} %", 100.0 * bound)
                }
                None => "no bound, as a reflectance is 1".into(),
            };
            line(
                "certificate",
                format!("{bound} (root mean square, 95 %; residual {:.2} %)", 100.0 * residual),
            );
        }
        let errors: Vec<String> = [(self.picture_error, "pixels"), (self.patch_error, "patches")]
            .iter()
            .filter_map(|(error, of)| Some(format!("{:.2} % of the {of}", 100.0 * (*error)?)))
            .collect();
        if !errors.is_empty() {
            line("error", format!("{} (root mean square of standard errors)", errors.join(", ")));
        }
        let (millions, tracing) = (self.rays as f64 * 1e-6, s.transport + s.render);
        let rays = match tracing {
            // Others traced them.
            0.0 => format!("{millions:.1} M"),
            _ => format!(
                "{millions:.1} M in {tracing:.2} s of tracing and shading, {:.1} M/s",
                millions / tracing
            ),
        };
        line("rays", rays);
        line(
            "seconds",
            format!(
                "load {:.3}, build {:.3}, transport {:.3}, solve {:.3}, render {:.3}, total {:.3}",
                s.load, s.build, s.transport, s.solve, s.render, s.total
            ),
        );
        if let Some(bytes) = self.peak_memory_bytes {
            line("peak memory", indicatif::BinaryBytes(bytes).to_string());
        }
        if let Some(exposure) = self.exposure {
            let how = if self.automatic_exposure { " (automatic)" } else { "" };
            let all = if self.exposures.is_empty() { &[exposure] } else { &self.exposures[..] };
            let all: Vec<String> = all.iter().map(|exposure| format!("{exposure:.4}")).collect();
            line("exposure", format!("{}{how}", all.join(", ")));
        }
        for file in &self.files {
            line("wrote", in_one_line(file));
        }
        text
    }
}

fn watts(power: [f64; 3]) -> String {
    let [r, g, b] = power;
    let mean = Rgb64::from(power).element_sum() / 3.0;
    let [r, g, b, mean] = [r, g, b, mean].map(|x| match x.abs() {
        0.0 | 1e-3..1e6 => format!("{x:.5}"),
        _ => format!("{x:.5e}"),
    });
    format!("{r} {g} {b} W (mean {mean})")
}
