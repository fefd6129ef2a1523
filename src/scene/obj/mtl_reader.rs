//! Reads MTL files line by line. Nothing in them is an error: a viewer shows such a model all the same.
//!
//! `tobj` reads the colours. It gets one at a time, so that what it refuses has a line, and always
//! three numbers, since it panics at the grey `Kd 0.5`.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::mtl_map::MapLine;
use crate::color::Rgb;
use crate::error::{Error, Result, Warning};
use crate::scene::text::{keyword_and_rest, number, numbered_lines, quote, words};

/// All materials of a model, with names that differ from each other.
#[derive(Debug, Default)]
pub(super) struct Library {
    pub entries: Vec<Entry>,
    /// The MTL files that were read.
    pub files: Vec<PathBuf>,
    /// Index into `entries`.
    by_name: HashMap<String, usize>,
}

/// One material and where it is defined. Lines count from 1.
#[derive(Debug, Default)]
pub(super) struct Entry {
    pub name: String,
    /// None for a material that no file defines.
    pub file: Option<PathBuf>,
    /// The line of `newmtl`.
    pub line: usize,
    pub kd: Option<Color>,
    pub ke: Option<Color>,
    pub ks: Option<Color>,
    /// Opacity; finite.
    pub d: Option<f32>,
    /// Transparency; finite.
    pub tr: Option<f32>,
    pub map_kd: Option<MapLine>,
    pub map_ke: Option<MapLine>,
    pub map_d: Option<MapLine>,
}

/// A colour, or why it is none, and the line where it stands.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Color {
    pub value: std::result::Result<Rgb, String>,
    pub line: usize,
}

impl Library {
    /// Adds the materials in the `text` of an MTL `file`. Whether values are in range is judged later, when the
    /// used materials are known.
    pub(super) fn add(&mut self, file: &Path, text: &str, warnings: &mut Vec<Warning>) {
        let mut checker = Checker {
            library: self,
            file,
            warnings,
            current: None,
            strays: Vec::new(),
            nameless: Vec::new(),
            first_statement: None,
            again: Vec::new(),
        };
        for (number, line) in numbered_lines(text) {
            checker.statement(number, &line);
        }
        checker.finish();
    }

    /// Index into `entries`.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// Adds a material that no file defines, so that its name is known at least.
    pub(super) fn add_undefined(&mut self, name: &str) {
        self.put(Entry { name: name.to_owned(), ..Entry::default() });
    }

    /// Puts `entry` into the place of the one with its name, or else at the end. So the last
    /// definition of a name counts.
    fn put(&mut self, entry: Entry) -> usize {
        if let Some(&index) = self.by_name.get(&entry.name) {
            self.entries[index] = entry;
            return index;
        }
        let index = self.entries.len();
        self.by_name.insert(entry.name.clone(), index);
        self.entries.push(entry);
        index
    }
}

/// Goes through the lines of one file.
struct Checker<'a> {
    library: &'a mut Library,
    file: &'a Path,
    warnings: &'a mut Vec<Warning>,
    /// Index of the entry that the lines belong to.
    current: Option<usize>,
    /// Lines that mean something, before the first `newmtl`.
    strays: Vec<usize>,
    /// Lines with `newmtl` alone.
    nameless: Vec<usize>,
    first_statement: Option<usize>,
    /// Lines that define a name again; of the first, what it says.
    again: Vec<(usize, Option<String>)>,
}

impl Checker<'_> {
    /// Lines without a bearing on diffuse light are passed over, well-formed or not.
    fn statement(&mut self, line: usize, text: &str) {
        let (keyword, rest) = keyword_and_rest(text);
        if !keyword.is_empty() {
            self.first_statement.get_or_insert(line);
        }
        match keyword {
            "newmtl" => self.newmtl(line, rest),
            "Kd" => self.set(line, |entry| entry.kd = Some(color(keyword, rest, line))),
            "Ke" => self.set(line, |entry| entry.ke = Some(color(keyword, rest, line))),
            "Ks" => self.set(line, |entry| entry.ks = Some(color(keyword, rest, line))),
            "d" => self.set(line, |entry| entry.d = last_number(rest).or(entry.d)),
            "Tr" => self.set(line, |entry| entry.tr = last_number(rest).or(entry.tr)),
            "map_Kd" => self.set(line, |entry| entry.map_kd = MapLine::parse(line, rest)),
            "map_Ke" => self.set(line, |entry| entry.map_ke = MapLine::parse(line, rest)),
            "map_d" => self.set(line, |entry| entry.map_d = MapLine::parse(line, rest)),
            _ => {}
        }
    }

    fn newmtl(&mut self, line: usize, name: &str) {
        if name.is_empty() {
            self.nameless.push(line);
        }
        if let Some(&index) = self.library.by_name.get(name) {
            let told = self.again.is_empty().then(|| self.duplicate(index));
            self.again.push((line, told));
        }
        self.current = Some(self.library.put(Entry {
            name: name.to_owned(),
            file: Some(self.file.to_path_buf()),
            line,
            ..Entry::default()
        }));
    }

    /// Sets a value of the entry that a line belongs to.
    fn set(&mut self, line: usize, value: impl FnOnce(&mut Entry)) {
        match self.current {
            Some(index) => value(&mut self.library.entries[index]),
            None => self.strays.push(line),
        }
    }

    fn finish(self) {
        if let (None, Some(line)) = (self.current, self.first_statement) {
            let text = "no `newmtl` in the file: it defines no material";
            self.warnings.push(Warning::in_file(self.file, Some(line), text));
        }
        if let Some((line, Some(told))) = self.again.first() {
            let more = match self.again.len() {
                1 => String::new(),
                count => format!(" ({count} such lines in all)"),
            };
            self.warnings.push(Warning::in_file(self.file, Some(*line), format!("{told}{more}")));
        }
        let kinds = [
            (self.strays, "a statement before the first `newmtl` is ignored"),
            (self.nameless, "`newmtl` without the name of a material: no face can have it"),
        ];
        for (lines, text) in kinds {
            if let Some(&first) = lines.first() {
                let text = format!("{text} ({} in all)", lines.len());
                self.warnings.push(Warning::in_file(self.file, Some(first), text));
            }
        }
    }

    fn duplicate(&self, earlier: usize) -> String {
        let earlier = &self.library.entries[earlier];
        let place = match &earlier.file {
            Some(file) if file != self.file => format!("{}:{}", file.display(), earlier.line),
            _ => format!("line {}", earlier.line),
        };
        let name = quote(&earlier.name);
        format!("material {name} is defined again and replaces the one in {place}")
    }
}

/// The number of `d 0.5` and of `d -halo 0.5`.
fn last_number(rest: &str) -> Option<f32> {
    words(rest).last().and_then(|word| number(word).ok())
}

fn color(keyword: &str, rest: &str, line: usize) -> Color {
    Color { value: rgb(keyword, rest).map_err(|error| error.cause().to_owned()), line }
}

/// A colour in linear RGB. One number means grey, by the MTL specification.
fn rgb(keyword: &str, rest: &str) -> Result<Rgb> {
    let given: Vec<&str> = words(rest).collect();
    if let [form @ ("spectral" | "xyz"), ..] = given[..] {
        return Err(Error::new(format!("`{keyword} {form}` is not supported"))
            .remedy(format!("write the colour in linear RGB as `{keyword} r g b`")));
    }
    let read = match given[..] {
        [grey] => read_by_tobj([grey; 3]),
        [r, g, b] => read_by_tobj([r, g, b]),
        _ => None,
    };
    read.ok_or_else(|| wrong_color(keyword, &given))
}

/// None if one of the words is not a finite number.
fn read_by_tobj(numbers: [&str; 3]) -> Option<Rgb> {
    // A vertical tab or a blank of Unicode is part of a word here, yet not for `tobj`.
    if numbers.iter().any(|word| word.contains(char::is_whitespace)) {
        return None;
    }
    let [r, g, b] = numbers;
    let text = format!("newmtl color\nKd {r} {g} {b}\n");
    let (materials, _) = tobj::load_mtl_buf(&mut text.as_bytes()).ok()?;
    materials.first()?.diffuse.map(Rgb::from_array).filter(|rgb| rgb.is_finite())
}

/// Finds out why the words are no colour.
fn wrong_color(keyword: &str, given: &[&str]) -> Error {
    let malformed = given.iter().find_map(|word| number::<f32>(word).err());
    malformed.unwrap_or_else(|| {
        Error::new(format!("`{keyword}` takes 1 or 3 numbers, this one has {}", given.len()))
            .remedy(format!("write `{keyword} r g b`"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str) -> (Library, Vec<String>) {
        let (mut library, mut warnings) = (Library::default(), Vec::new());
        library.add(Path::new("a.mtl"), text, &mut warnings);
        (library, warnings.iter().map(Warning::to_string).collect())
    }

    fn value(color: &Option<Color>) -> std::result::Result<Rgb, String> {
        color.as_ref().expect("a colour").value.clone()
    }

    #[test]
    fn one_number_is_grey_and_other_statements_are_passed_over() {
        let text = "newmtl a b\r\nKd 0.5\r\nKs what\nd -halo 0.25\nTr x\nKe 1 2 3 # lamp\nNs ?\n";
        let (library, warnings) = check(text);
        let [entry] = &library.entries[..] else { panic!("one material") };
        assert_eq!((entry.name.as_str(), entry.d, entry.tr), ("a b", Some(0.25), None));
        assert_eq!(entry.kd, Some(Color { value: Ok(Rgb::splat(0.5)), line: 2 }));
        assert_eq!(value(&entry.ke), Ok(Rgb::new(1.0, 2.0, 3.0)));
        assert!(value(&entry.ks).is_err() && warnings.is_empty());
    }

    #[test]
    fn a_malformed_colour_knows_why() {
        for (rest, why) in [
            ("1 2", "`Kd` takes 1 or 3 numbers, this one has 2"),
            ("", "`Kd` takes 1 or 3 numbers, this one has 0"),
            ("0 0 0 0", "`Kd` takes 1 or 3 numbers, this one has 4"),
            ("0 0 O", "`O` is not a number"),
            ("0 0 inf", "`inf` is not a finite number"),
            ("spectral a.rfl", "`Kd spectral` is not supported"),
            ("xyz 1 1 1", "`Kd xyz` is not supported"),
        ] {
            let (library, _) = check(&format!("newmtl a\nKd {rest}"));
            assert_eq!(value(&library.entries[0].kd), Err(why.into()), "{rest}");
        }
        let (library, _) = check("newmtl a\nKd 0 \u{a0} 1");
        assert!(value(&library.entries[0].kd).unwrap_err().ends_with("is not a number"));
    }

    #[test]
    fn statements_that_belong_to_no_material_are_warnings() {
        let (library, warnings) = check("Kd 0 0 0\nmap_Kd x.png\nnewmtl a\nnewmtl\nKd 1\n");
        assert_eq!(library.entries[0].kd, None);
        assert_eq!(
            warnings,
            [
                "a.mtl:1: a statement before the first `newmtl` is ignored (2 in all)",
                "a.mtl:4: `newmtl` without the name of a material: no face can have it (1 in all)",
            ]
        );
    }

    #[test]
    fn prose_is_told_and_many_definitions_of_a_name_are_one_warning() {
        let (library, warnings) = check("# materials\nThe quick brown fox\njumps.\n");
        assert!(library.entries.is_empty());
        assert_eq!(warnings, ["a.mtl:2: no `newmtl` in the file: it defines no material"]);
        assert!(check("# nothing\n\n").1.is_empty());
        let (_, warnings) = check(&"newmtl a\n".repeat(1000));
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].ends_with("the one in line 1 (999 such lines in all)"), "{warnings:?}");
    }

    #[test]
    fn the_last_of_two_definitions_counts_and_is_told() {
        let (library, warnings) = check("newmtl a\nKd 0.1\nnewmtl b\nnewmtl a\nKe 9\n");
        let [a, b] = &library.entries[..] else { panic!("two materials") };
        assert_eq!((a.name.as_str(), b.name.as_str()), ("a", "b"));
        assert_eq!((&a.kd, value(&a.ke)), (&None, Ok(Rgb::splat(9.0))));
        assert_eq!(
            warnings,
            ["a.mtl:4: material `a` is defined again and replaces the one in line 1"]
        );
    }
}
