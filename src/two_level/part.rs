//! A part of the patches of a solution in two levels, and the file that keeps it.

use crate::begun::ANEW;
use crate::color::Rgb64;
use crate::error::{Error, Result};
use crate::export::file::{Inputs, Output, write_all};
use crate::export::sealed::{Seal, fingerprint};
use crate::geometry::KernelKind;
use crate::memory;
use crate::solution::{PatchLight, Solution};
use serde::{Deserialize, Serialize};
use std::fmt::{self, Display, Formatter};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The share `number` of `of`, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Share {
    pub number: u32,
    pub of: u32,
}

impl Share {
    pub const WHOLE: Share = Share { number: 1, of: 1 };

    /// The most shares.
    pub const MOST: u32 = 1 << 20;

    fn is_possible(self) -> bool {
        1 <= self.number && self.number <= self.of && self.of <= Share::MOST
    }
}

impl Display for Share {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Share {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Share, String> {
        let parsed = text.split_once('/').map(|(number, of)| (number.parse(), of.parse()));
        match parsed {
            Some((Ok(number), Ok(of))) if (Share { number, of }).is_possible() => {
                Ok(Share { number, of })
            }
            _ => Err("expected a part and their number, such as 3/8".into()),
        }
    }
}

/// Some of the patches of one solution, with their light.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Part {
    share: Share,
    pub(super) whole: Whole,
    /// The solution without its patches' light, in the first part.
    pub(super) unlit: Option<Box<Solution>>,
    /// Of the patches that are done.
    pub(super) light: PatchLight,
    /// The power in watts that each block of patches absorbs.
    pub(super) absorbed: Vec<Rgb64>,
    /// Rays traced for the patches.
    pub(super) rays: u64,
    /// Where it was read from.
    #[serde(skip)]
    pub(super) file: PathBuf,
}

/// What the parts of one solution have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Whole {
    pub patches: u32,
    /// See [`Solution::fingerprints`].
    pub scene: u32,
    pub choices: u32,
    /// Of all that the solution holds beside, and the kernel.
    pub rest: u32,
}

const SEAL: Seal = Seal {
    magic: b"isolux part\n",
    version: 2,
    name: "part file",
    command: "isolux solve SCENE --part k/N -o NAME.part",
};

/// Light, error and uncovered share, and the same again in the bytes of a file.
const BYTES_PER_PATCH: u64 = 40;

impl Part {
    /// Patches that are always in one part: sums over blocks do not depend on the parts.
    pub(super) const BLOCK: usize = 1024;

    /// A part of which nothing is done. `unlit`: the solution without light.
    pub(crate) fn new(share: Share, patches: usize, unlit: Solution, kernel: KernelKind) -> Part {
        let [scene, choices] = unlit.fingerprints();
        let Solution { title, figures, camera, views, image, .. } = &unlit;
        let rest = (title, figures, camera, views, image, kernel);
        let whole = Whole { patches: patches as u32, scene, choices, rest: fingerprint(&rest) };
        Part {
            share,
            whole,
            unlit: (share.number == 1).then(|| unlit.into()),
            light: PatchLight::default(),
            absorbed: Vec::new(),
            rays: 0,
            file: PathBuf::new(),
        }
    }

    pub fn share(&self) -> Share {
        self.share
    }

    /// The numbers of the patches that belong to it.
    pub fn patches(&self) -> Range<usize> {
        let patches = self.whole.patches as usize;
        let blocks = patches.div_ceil(Part::BLOCK) as u64;
        let end = |number: u32| {
            let block = blocks * number as u64 / self.share.of as u64;
            (block as usize * Part::BLOCK).min(patches)
        };
        end(self.share.number - 1)..end(self.share.number)
    }

    /// Whether none of its patches has its light.
    pub fn is_empty(&self) -> bool {
        self.light.irradiance.is_empty()
    }

    /// Whether all its patches have their light.
    pub fn is_finished(&self) -> bool {
        self.light.irradiance.len() == self.patches().len()
    }

    /// Rays traced for its patches.
    pub fn rays(&self) -> u64 {
        self.rays
    }

    /// Takes over what was done of this part before.
    ///
    /// # Errors
    /// Another part, or one of another solution.
    pub(crate) fn take_up(&mut self, begun: Part) -> Result<()> {
        if (begun.share, begun.whole) != (self.share, self.whole) {
            return Err(begun
                .error("this was begun with another scene, other flags or as another part")
                .remedy(ANEW));
        }
        self.light = begun.light;
        self.absorbed = begun.absorbed;
        self.rays = begun.rays;
        Ok(())
    }

    /// Works out what will be stored, before any of it is.
    ///
    /// # Errors
    /// More than there is.
    pub(crate) fn check_memory(&self) -> Result<()> {
        let patches = self.patches().len();
        let bytes = patches as u64 * BYTES_PER_PATCH;
        let what = format!("the light of {patches} patches");
        memory::check(
            &what,
            bytes,
            memory::available(),
            "take larger patches, or solve in more parts",
        )
    }

    /// Forgets all but the first `done` patches, which are whole blocks.
    pub(super) fn truncate(&mut self, done: usize) {
        self.light.irradiance.truncate(done);
        self.light.error.truncate(done);
        self.light.uncovered.truncate(done);
        self.absorbed.truncate(done / Part::BLOCK);
    }

    pub(super) fn reserve(&mut self) {
        let more = self.patches().len() - self.light.irradiance.len();
        self.light.irradiance.reserve_exact(more);
        self.light.error.reserve_exact(more);
        self.light.uncovered.reserve_exact(more);
    }

    /// Writes a part file, whole or not at all.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let output = Output { path: path.as_ref().to_path_buf(), bytes: self.to_bytes() };
        write_all(vec![output], &Inputs::default())
    }

    /// The bytes of a part file.
    pub fn to_bytes(&self) -> Vec<u8> {
        SEAL.close(self)
    }

    /// Reads what [`Part::to_bytes`] made.
    ///
    /// # Errors
    /// Bytes of something else, of another version, or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Part> {
        let part: Part = SEAL.open(bytes)?;
        if part.is_possible() { Ok(part) } else { Err(SEAL.contradiction()) }
    }

    /// # Errors
    /// See [`Part::from_bytes`]; or a file that cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<Part> {
        let path = path.as_ref();
        let part = Part::from_bytes(&SEAL.read(path)?).map_err(|error| error.in_file(path))?;
        Ok(Part { file: path.to_path_buf(), ..part })
    }

    fn is_possible(&self) -> bool {
        if !self.share.is_possible() || self.unlit.is_some() != (self.share.number == 1) {
            return false;
        }
        let done = self.light.irradiance.len();
        let whole_blocks = done.is_multiple_of(Part::BLOCK) || self.is_finished();
        done <= self.patches().len()
            && whole_blocks
            && self.light.error.len() == done
            && self.light.is_of(done)
            && self.light.is_possible()
            && self.absorbed.len() == done.div_ceil(Part::BLOCK)
            && self.absorbed.iter().all(|power| power.is_finite())
    }

    /// An error that concerns this part.
    pub(super) fn error(&self, cause: impl Into<String>) -> Error {
        Error::new(cause).in_file(&self.file)
    }
}
