//! How light is solved: one set of options for scene descriptions, the command line and programs.
//!
//! Nothing is filled in here, so that what was asked for differs from a default; the defaults come in
//! where the options are put to use, in [`Choices::new`](crate::radiosity::Choices::new).

use crate::error::{Error, Result};
use crate::geometry::triangle::MAX_LEVEL;
use crate::sampling::PointSet;
use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// How form factors are estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Samples of each pair of patches: reciprocal by construction, n² work.
    Pairs,
    /// Cosine-distributed rays from each patch: rows that sum to 1, n work.
    #[default]
    Hemisphere,
}

/// How the radiosity equation is solved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Every patch from the last iterate.
    Jacobi,
    /// Every patch from the newest values.
    #[default]
    GaussSeidel,
    /// Shooting, which stores no matrix.
    Southwell,
    /// Every patch by rays of its own, which read a solution on fewer and larger elements.
    TwoLevel,
}

/// Samples per pair of patches, unless another number is asked for.
pub(crate) const PAIR_SAMPLES: u32 = 9;
/// Rays per patch.
pub(crate) const HEMISPHERE_RAYS: u32 = 128;
/// Paths per patch of a solution in two levels.
pub(crate) const PATHS: u32 = 64;
/// From this many patches on, two levels are the default.
pub(crate) const MANY_PATCHES: u64 = 100_000;
/// Points of small emitters per patch.
pub(crate) const DIRECT_SAMPLES: u32 = 32;
/// The relative residual at which to stop.
pub(crate) const TOLERANCE: f64 = 1e-4;
/// Of the available memory, how much a matrix may take.
pub(crate) const MEMORY_PERCENT: u64 = 80;
/// Patches that the subdivision aims at: good and quick for a first picture.
pub(crate) const PATCHES: usize = 20_000;

/// The name of a choice on the command line and in a description.
fn name_of(choice: impl ValueEnum) -> String {
    choice.to_possible_value().expect("no choice is hidden").get_name().to_string()
}

/// The options that a user can set.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    pub patches: PatchSettings,
    pub light: LightSettings,
    /// The seed of all random numbers.
    pub seed: u64,
}

impl Settings {
    /// The seed unless another is asked for.
    pub const SEED: u64 = 1;
}

impl Default for Settings {
    fn default() -> Self {
        let (patches, light) = (PatchSettings::default(), LightSettings::default());
        Settings { patches, light, seed: Settings::SEED }
    }
}

/// How finely triangles are split: `[patches]` in a description.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, clap::Args)]
#[serde(deny_unknown_fields)]
pub struct PatchSettings {
    /// Split every triangle into 4^N patches
    #[arg(long, value_name = "N", conflicts_with = "max_edge", help_heading = "Light")]
    pub levels: Option<u32>,

    /// No edge of a patch is longer, in the scene's units.
    #[arg(long, value_name = "LENGTH", help_heading = "Light", help = format!(
        "Split triangles until no patch edge is longer, in the scene's units [default: the scene's, \
         else a length that makes about {PATCHES} patches]"))]
    pub max_edge: Option<f64>,
}

/// How their light is solved: `[light]` in a description.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, clap::Args)]
#[serde(deny_unknown_fields)]
pub struct LightSettings {
    /// How form factors are estimated.
    #[arg(
        long,
        hide_possible_values = true,
        value_name = "pairs|hemisphere",
        help_heading = "Light",
        help = format!(
            "How form factors are estimated: samples of each pair of patches, or rays from each patch \
             [default: {}]", name_of(Method::default()))
    )]
    pub form_factors: Option<Method>,

    /// Samples per pair, or rays per patch.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MAX_SAMPLES as i64),
          help_heading = "Light", help = format!(
              "Samples per pair [default: {PAIR_SAMPLES}], or rays per patch [default: {HEMISPHERE_RAYS}; with \
               --solver {}, {PATHS}]", name_of(Solver::TwoLevel)))]
    pub samples: Option<u32>,

    /// Where samples lie.
    #[arg(
        long,
        hide_possible_values = true,
        value_name = "sobol|random|regular",
        help_heading = "Light",
        help = format!(
            "Where samples lie: low-discrepancy, independent, or the centroids of a regular subdivision \
             [default: {}]", name_of(PointSet::default()))
    )]
    pub points: Option<PointSet>,

    /// Points of the emitters sampled for each patch's direct light; 0 leaves it to the form factors.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=MAX_SAMPLES as i64),
          help_heading = "Light", help = format!(
              "Points of the emitters sampled for each patch's direct light; 0 leaves it to the form \
               factors [default: {DIRECT_SAMPLES} with --form-factors {} if the emitters are small, \
               else 0]", name_of(Method::Hemisphere)))]
    pub direct: Option<u32>,

    /// How the radiosity equation is solved.
    #[arg(
        long,
        hide_possible_values = true,
        value_name = "jacobi|gauss-seidel|southwell|two-level",
        help_heading = "Light",
        help = format!(
            "How the radiosity equation is solved; {} stores no matrix, and {} solves on about {PATCHES} \
             elements from which every patch gathers its light [default: {}, and {} if there are more than \
             {MANY_PATCHES} patches with --form-factors {}]",
            name_of(Solver::Southwell), name_of(Solver::TwoLevel), name_of(Solver::default()),
            name_of(Solver::TwoLevel), name_of(Method::Hemisphere))
    )]
    pub solver: Option<Solver>,

    /// Relative residual at which to stop.
    #[arg(long, value_name = "X", value_parser = parse_tolerance, help_heading = "Light",
          help = format!("Relative residual at which to stop [default: {TOLERANCE}]"))]
    pub tolerance: Option<f64>,

    /// Do exactly N iterations (for southwell: shots), whatever the residual; not with --tolerance
    #[arg(long, value_name = "N", conflicts_with = "tolerance", help_heading = "Light")]
    pub iterations: Option<usize>,

    /// The most memory that a matrix may take, in MiB.
    #[arg(long, value_name = "MIB", help_heading = "Light", help = format!(
        "The most memory that a matrix may take, in MiB [default: {MEMORY_PERCENT} % of what is \
         available]"))]
    pub memory: Option<u64>,
}

/// The most samples of anything.
pub const MAX_SAMPLES: u32 = 1 << 20;

impl PatchSettings {
    /// These, or the others where these ask for nothing.
    pub fn or(&self, other: &PatchSettings) -> PatchSettings {
        if *self == PatchSettings::default() { other.clone() } else { self.clone() }
    }

    pub(crate) fn check(&self) -> Result<()> {
        if self.levels.is_some() && self.max_edge.is_some() {
            return Err(Error::new("[patches]: both levels and max_edge").remedy("give one"));
        }
        if self.levels.is_some_and(|levels| levels > MAX_LEVEL) {
            return Err(Error::new(format!("[patches]: levels is above {MAX_LEVEL}"))
                .remedy("each level quadruples the patches; 2 to 5 are usual"));
        }
        if self.max_edge.is_some_and(|length| !(length > 0.0 && length.is_finite())) {
            return Err(Error::new("[patches]: max_edge is not a number above zero")
                .remedy("give a length in the scene's units"));
        }
        Ok(())
    }
}

impl LightSettings {
    /// Each of these, or the other one where this is not given. A tolerance and a number of iterations
    /// replace each other.
    pub fn or(&self, other: &LightSettings) -> LightSettings {
        let own_stop = self.tolerance.is_some() || self.iterations.is_some();
        let stop = if own_stop { self } else { other };
        LightSettings {
            form_factors: self.form_factors.or(other.form_factors),
            samples: self.samples.or(other.samples),
            points: self.points.or(other.points),
            direct: self.direct.or(other.direct),
            solver: self.solver.or(other.solver),
            tolerance: stop.tolerance,
            iterations: stop.iterations,
            memory: self.memory.or(other.memory),
        }
    }

    /// Whether this many patches are solved in two levels, if nothing else is asked for.
    pub(crate) fn suit_two_levels(&self, patches: u64) -> bool {
        patches > MANY_PATCHES
            && self.solver.is_none()
            && self.form_factors.unwrap_or_default() == Method::Hemisphere
            && self.points.unwrap_or_default() == PointSet::Sobol
    }

    pub(crate) fn check(&self) -> Result<()> {
        let bad = |what: &str, remedy: &str| {
            Err(Error::new(format!("[light]: {what}")).remedy(remedy.to_string()))
        };
        if self.samples.is_some_and(|n| !(1..=MAX_SAMPLES).contains(&n)) {
            return bad("samples is outside 1 to 1048576", "256 rays or 9 samples are usual");
        }
        if self.direct.is_some_and(|n| n > MAX_SAMPLES) {
            return bad("direct is above 1048576", "64 is usual");
        }
        if self.tolerance.is_some() && self.iterations.is_some() {
            return bad("both tolerance and iterations", "give one");
        }
        match self.tolerance.map(check_tolerance) {
            Some(Err(expected)) => bad("tolerance is out of its range", &expected),
            _ => Ok(()),
        }
    }
}

fn parse_tolerance(text: &str) -> std::result::Result<f64, String> {
    check_tolerance(text.parse().unwrap_or(f64::NAN))
}

/// Sums of f64 leave a relative residual near 1e-15.
fn check_tolerance(tolerance: f64) -> std::result::Result<f64, String> {
    if (1e-14..1.0).contains(&tolerance) {
        return Ok(tolerance);
    }
    Err("expected a number from 1e-14 to 1; for a fixed number of iterations give iterations"
        .into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_asked_for_comes_before_what_the_scene_wishes() {
        let scene = LightSettings { samples: Some(64), tolerance: Some(0.5), ..Default::default() };
        let asked = LightSettings { samples: Some(9), iterations: Some(3), ..Default::default() };
        let both = asked.or(&scene);
        assert_eq!((both.samples, both.iterations, both.tolerance), (Some(9), Some(3), None));
        assert_eq!(LightSettings::default().or(&scene), scene);
        let level = PatchSettings { levels: Some(2), max_edge: None };
        let edge = PatchSettings { levels: None, max_edge: Some(0.5) };
        assert_eq!(level.or(&edge), level);
        assert_eq!(PatchSettings::default().or(&edge), edge);
    }

    #[test]
    fn a_tolerance_that_cannot_be_reached_is_refused() {
        for bad in ["0", "1", "nan", "1e-15", "x"] {
            assert!(parse_tolerance(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_tolerance("1e-4"), Ok(1e-4));
    }
}
