//! Files that only isolux reads: a magic word, and a checksum against damage.
//!
//! ```text
//! magic   version (u32)   CRC-32 of the rest (u32)   a value, by postcard
//! ```
//!
//! Numbers are little-endian and floats are stored as their bits.

use crate::error::{Error, Result};
use crate::scene::text::{read_bytes_if, unread};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;

/// A number of a value, to tell it from others: two have the same with a probability of 2⁻³².
pub(crate) fn fingerprint(value: &impl Serialize) -> u32 {
    crc32fast::hash(&postcard::to_stdvec(value).expect("numbers, strings and lists"))
}

/// A kind of file.
pub(crate) struct Seal {
    pub(crate) magic: &'static [u8],
    pub(crate) version: u32,
    /// Its name in errors, such as "light file".
    pub(crate) name: &'static str,
    /// The command that makes one.
    pub(crate) command: &'static str,
}

impl Seal {
    /// The bytes of a file with this value.
    pub(crate) fn close(&self, value: &impl Serialize) -> Vec<u8> {
        let header = [self.magic, &self.version.to_le_bytes(), &[0; 4]].concat();
        let start = header.len();
        let mut bytes = postcard::to_extend(value, header).expect("numbers, strings and lists");
        let checksum = crc32fast::hash(&bytes[start..]);
        bytes[start - 4..start].copy_from_slice(&checksum.to_le_bytes());
        bytes
    }

    /// Reads what [`Seal::close`] made.
    ///
    /// # Errors
    /// Bytes of something else, of another version, or damaged.
    pub(crate) fn open<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T> {
        let (name, command) = (self.name, self.command);
        let Some(rest) = bytes.strip_prefix(self.magic) else {
            return Err(
                Error::new(format!("this is not a {name}")).remedy(format!("make one: {command}"))
            );
        };
        let damaged = || {
            Error::new(format!("the {name} is damaged or was cut short"))
                .remedy(format!("copy it again, or make it again: {command}"))
        };
        let number = |at: usize| -> Result<u32> {
            let bytes = rest.get(at..at + 4).ok_or_else(damaged)?;
            Ok(u32::from_le_bytes(bytes.try_into().expect("four bytes")))
        };
        let (version, checksum) = (number(0)?, number(4)?);
        if version != self.version {
            return Err(Error::new(format!(
                "the {name} is of version {version}, and this isolux reads version {}",
                self.version
            ))
            .remedy(format!("make it again: {command}")));
        }
        let body = &rest[8..];
        if crc32fast::hash(body) != checksum {
            return Err(damaged());
        }
        match postcard::take_from_bytes(body) {
            Ok((value, [])) => Ok(value),
            _ => Err(damaged()),
        }
    }

    /// # Errors
    /// A file that cannot be read.
    pub(crate) fn read(&self, path: &Path) -> Result<Vec<u8>> {
        read_bytes_if(path, |head| head.starts_with(self.magic))
            .map_err(|error| unread(path, &format!("the {}", self.name), &error))
    }

    /// A file whose parts cannot belong together.
    pub(crate) fn contradiction(&self) -> Error {
        Error::new(format!("the {} contradicts itself", self.name))
            .remedy(format!("make it again: {}", self.command))
    }
}

/// Changes a few bytes of what a file holds to such as may mislead its reader.
#[cfg(test)]
pub(crate) fn forge(bytes: &mut [u8], random: &mut fastrand::Rng) {
    let telling = [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e38, 1e-45, 1.0];
    let number = telling[random.usize(0..telling.len())].to_le_bytes();
    let at = random.usize(0..bytes.len());
    match random.usize(0..3) {
        0 => bytes[at..].iter_mut().zip(number).for_each(|(byte, new)| *byte = new),
        1 => bytes[at] = random.u8(..),
        // Counts, goals and times are at the end.
        _ => {
            let near_end = bytes.len() - 1 - random.usize(0..bytes.len().min(40));
            bytes[near_end] = [0, 1, 0x7f, 0xff][random.usize(0..4)];
        }
    }
}
