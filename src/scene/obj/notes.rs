//! One warning per kind of thing that was put right in the materials, with the count and the first place.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::error::Warning;
use crate::scene::text::quote;

/// What a note is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    NoKd,
    BadKd,
    BrightKd,
    NegativeKd,
    BadKe,
    Metal,
    Clear,
    Unseen,
    MissingPicture,
    BadPicture,
    OutsidePicture,
}

impl Kind {
    fn text(self) -> &'static str {
        match self {
            Kind::NoKd => "no Kd: the reflectance is 0.5, or 0 of a lamp",
            Kind::BadKd => "Kd is malformed: the reflectance is 0.5, or 0 of a lamp",
            Kind::BrightKd => "Kd above 1 is scaled so that its largest component is 1",
            Kind::NegativeKd => "Kd below 0 is taken as 0",
            Kind::BadKe => "Ke is malformed, negative or enormous: taken as 0, or as 1e12",
            Kind::Metal => "mirrors and metals (Kd 0 with Ks) reflect Ks diffusely",
            Kind::Clear => "light goes straight through the share 1 - d (d, Tr), without bending",
            Kind::Unseen => {
                "opacity 0 (d 0, Tr 1) is taken as solid: by the format nothing of it would be seen"
            }
            Kind::MissingPicture => "no such picture: Kd is used alone, or 0.5 where it is 0",
            Kind::BadPicture => "cannot read the picture: Kd is used alone, or 0.5 where it is 0",
            Kind::OutsidePicture => "a picture outside the material file's folder was read",
        }
    }
}

/// Notes of one kind.
#[derive(Debug)]
struct Note {
    kind: Kind,
    file: PathBuf,
    line: usize,
    /// The first few, quoted, without repetition.
    names: Vec<String>,
    /// All of them.
    known: HashSet<String>,
    detail: Option<String>,
}

/// All notes, in the order of their kinds' first.
#[derive(Debug, Default)]
pub(super) struct Notes(Vec<Note>);

/// At most this many names are listed.
const LISTED: usize = 8;

impl Notes {
    /// Notes that the material or picture `name` is of this kind.
    pub(super) fn add(&mut self, kind: Kind, file: &Path, line: usize, name: &str) {
        self.add_with(kind, file, line, name, None);
    }

    /// As `add`, with a cause that is shown if it is the kind's first.
    pub(super) fn add_with(
        &mut self,
        kind: Kind,
        file: &Path,
        line: usize,
        name: &str,
        detail: Option<String>,
    ) {
        let at = match self.0.iter().position(|note| note.kind == kind) {
            Some(at) => at,
            None => {
                let (file, names, known) = (file.to_path_buf(), Vec::new(), HashSet::new());
                self.0.push(Note { kind, file, line, names, known, detail });
                self.0.len() - 1
            }
        };
        let note = &mut self.0[at];
        if note.known.insert(name.to_owned()) && note.names.len() < LISTED {
            note.names.push(quote(name));
        }
    }

    pub(super) fn warnings(self) -> impl Iterator<Item = Warning> {
        self.0.into_iter().map(|note| {
            let count = note.known.len();
            let more = if count > LISTED { ", …" } else { "" };
            let names = note.names.join(", ");
            let detail = note.detail.map(|detail| format!("; the first: {detail}"));
            let text = format!(
                "{} ({count} in all: {names}{more}{})",
                note.kind.text(),
                detail.unwrap_or_default()
            );
            Warning::in_file(&note.file, Some(note.line), text)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_one_warning_with_its_names_and_first_place() {
        let mut notes = Notes::default();
        let file = Path::new("a.mtl");
        notes.add(Kind::BrightKd, file, 4, "a");
        notes.add_with(Kind::BadKd, file, 5, "b", Some("`x` is not a number".into()));
        notes.add(Kind::BrightKd, file, 6, "c");
        notes.add(Kind::BrightKd, file, 9, "a");
        let said: Vec<String> = notes.warnings().map(|w| w.to_string()).collect();
        assert_eq!(
            said,
            [
                "a.mtl:4: Kd above 1 is scaled so that its largest component is 1 \
                 (2 in all: `a`, `c`)",
                "a.mtl:5: Kd is malformed: the reflectance is 0.5, or 0 of a lamp \
                 (1 in all: `b`; the first: `x` is not a number)",
            ]
        );
    }
}
