//! Reads MTL files line by line. Of a material, only `Kd` and `Ke` matter to diffuse light.
//!
//! `tobj` reads the colours. It gets one at a time, so that what it refuses has a line, and always
//! three numbers, since it panics at the grey `Kd 0.5`.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

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
    textured: bool,
}

/// A colour and the line where it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Color {
    pub value: Rgb,
    pub line: usize,
}

impl Library {
    /// Checks the `text` of an MTL `file` and adds its materials. Fails at the first line that has
    /// no meaning; whether values are in range is judged later, when the used materials are known.
    pub(super) fn add(
        &mut self,
        file: &Path,
        text: &str,
        warnings: &mut Vec<Warning>,
    ) -> Result<()> {
        let mut checker = Checker { library: self, file, warnings, current: None };
        for (number, line) in numbered_lines(text) {
            checker.statement(number, &line).map_err(|e| e.in_file(file).at_line(number))?;
        }
        checker.warn_of_textures();
        Ok(())
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
}

impl Checker<'_> {
    /// Lines without a bearing on diffuse light are passed over, well-formed or not.
    fn statement(&mut self, line: usize, text: &str) -> Result<()> {
        let (keyword, rest) = keyword_and_rest(text);
        match keyword {
            "newmtl" => self.newmtl(line, rest)?,
            "Kd" => self.entry(keyword)?.kd = Some(Color { value: rgb(keyword, rest)?, line }),
            "Ke" => self.entry(keyword)?.ke = Some(Color { value: rgb(keyword, rest)?, line }),
            "map_Kd" | "map_Ke" => self.entry(keyword)?.textured = true,
            _ => {}
        }
        Ok(())
    }

    fn newmtl(&mut self, line: usize, name: &str) -> Result<()> {
        if name.is_empty() {
            return Err(Error::new("`newmtl` without the name of a material")
                .remedy("add the name or delete the material"));
        }
        if let Some(&index) = self.library.by_name.get(name) {
            self.warn_of_duplicate(line, index);
        }
        self.current = Some(self.library.put(Entry {
            name: name.to_owned(),
            file: Some(self.file.to_path_buf()),
            line,
            ..Entry::default()
        }));
        Ok(())
    }

    /// The entry that a line with `keyword` belongs to.
    fn entry(&mut self, keyword: &str) -> Result<&mut Entry> {
        match self.current {
            Some(index) => Ok(&mut self.library.entries[index]),
            None => Err(Error::new(format!("`{keyword}` before the first `newmtl`"))
                .remedy("name the material with `newmtl` first, or delete the line")),
        }
    }

    fn warn_of_duplicate(&mut self, line: usize, earlier: usize) {
        let earlier = &self.library.entries[earlier];
        let place = match &earlier.file {
            Some(file) if file != self.file => format!("{}:{}", file.display(), earlier.line),
            _ => format!("line {}", earlier.line),
        };
        let name = quote(&earlier.name);
        let text = format!("material {name} is defined again and replaces the one in {place}");
        self.warnings.push(Warning::in_file(self.file, Some(line), text));
    }

    fn warn_of_textures(&mut self) {
        let in_this_file = |entry: &&Entry| entry.file.as_deref() == Some(self.file);
        let entries = self.library.entries.iter().filter(in_this_file);
        let count = entries.filter(|entry| entry.textured).count();
        if count > 0 {
            let text = format!(
                "textures (`map_Kd`, `map_Ke`) are ignored, Kd and Ke are used alone \
                 (materials: {count})"
            );
            self.warnings.push(Warning::in_file(self.file, None, text));
        }
    }
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

    fn check(text: &str) -> Result<(Library, Vec<String>)> {
        let (mut library, mut warnings) = (Library::default(), Vec::new());
        library.add(Path::new("a.mtl"), text, &mut warnings)?;
        Ok((library, warnings.iter().map(Warning::to_string).collect()))
    }

    fn error_of(text: &str) -> String {
        let error = check(text).expect_err(text).to_string();
        error.lines().next().unwrap_or_default().to_owned()
    }

    #[test]
    fn one_number_is_grey_and_other_statements_are_passed_over() {
        let text = "newmtl a b\r\nKd 0.5\r\nKs what\nd -halo 1\nKe 1 2 3 # lamp\n";
        let (library, warnings) = check(text).unwrap();
        let [entry] = &library.entries[..] else { panic!("one material") };
        assert_eq!(entry.name, "a b");
        assert_eq!(entry.kd, Some(Color { value: Rgb::splat(0.5), line: 2 }));
        assert_eq!(entry.ke, Some(Color { value: Rgb::new(1.0, 2.0, 3.0), line: 5 }));
        assert!(warnings.is_empty());
    }

    #[test]
    fn each_malformed_line_is_named() {
        assert_eq!(
            error_of("newmtl a\nKd 1 2"),
            "a.mtl:2: `Kd` takes 1 or 3 numbers, this one has 2"
        );
        assert_eq!(error_of("newmtl a\nKe"), "a.mtl:2: `Ke` takes 1 or 3 numbers, this one has 0");
        assert_eq!(
            error_of("newmtl a\nKd 0 0 0 0"),
            "a.mtl:2: `Kd` takes 1 or 3 numbers, this one has 4"
        );
        assert!(error_of("newmtl a\nKd 0 \u{a0} 1").ends_with("is not a number"));
        assert_eq!(error_of("newmtl a\nKd 0 0 O"), "a.mtl:2: `O` is not a number");
        assert_eq!(error_of("newmtl a\nKe 0 0 inf"), "a.mtl:2: `inf` is not a finite number");
        assert_eq!(
            error_of("newmtl a\nKd spectral a.rfl"),
            "a.mtl:2: `Kd spectral` is not supported"
        );
        assert_eq!(error_of("newmtl a\nKd xyz 1 1 1"), "a.mtl:2: `Kd xyz` is not supported");
        assert_eq!(error_of("\nnewmtl  "), "a.mtl:2: `newmtl` without the name of a material");
        assert_eq!(error_of("Kd 0 0 0\nnewmtl a"), "a.mtl:1: `Kd` before the first `newmtl`");
    }

    #[test]
    fn the_last_of_two_definitions_counts_and_is_told() {
        let (library, warnings) = check("newmtl a\nKd 0.1\nnewmtl b\nnewmtl a\nKe 9\n").unwrap();
        let [a, b] = &library.entries[..] else { panic!("two materials") };
        assert_eq!((a.name.as_str(), b.name.as_str()), ("a", "b"));
        assert_eq!((a.kd, a.ke), (None, Some(Color { value: Rgb::splat(9.0), line: 5 })));
        assert_eq!(
            warnings,
            ["a.mtl:4: material `a` is defined again and replaces the one in line 1"]
        );
    }

    #[test]
    fn textures_are_told_once_with_the_number_of_materials() {
        let text = "newmtl a\nmap_Kd x.png\nmap_Ke y.png\nnewmtl b\nnewmtl c\nmap_Kd z.png\n";
        let (_, warnings) = check(text).unwrap();
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].starts_with("a.mtl: textures"));
        assert!(warnings[0].ends_with("(materials: 2)"));
    }
}
