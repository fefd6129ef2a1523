//! Checks MTL files line by line and reduces them to what `tobj` is to read: `newmtl`, and `Kd`
//! and `Ke` with three numbers each. `tobj` itself panics at the grey `Kd 0.5`.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::text::{keyword_and_rest, number, numbered_lines, quote, words};
use crate::error::{Error, Result, Warning};

/// All materials of a model, with names that differ from each other.
#[derive(Debug, Default)]
pub(super) struct Library {
    pub entries: Vec<Entry>,
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
    pub kd_line: Option<usize>,
    pub ke_line: Option<usize>,
    textured: bool,
    /// The lines for `tobj`.
    text: String,
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

    /// The materials as one MTL text for `tobj`, in the order of `entries`.
    pub(super) fn text(&self) -> String {
        self.entries.iter().map(|entry| format!("newmtl {}\n{}", entry.name, entry.text)).collect()
    }

    /// Puts `entry` into the place of the one with its name, or else at the end. So the last
    /// definition of a name counts, as it does in `tobj`.
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
            "Kd" => self.color(keyword, rest)?.kd_line = Some(line),
            "Ke" => self.color(keyword, rest)?.ke_line = Some(line),
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

    fn color(&mut self, keyword: &str, rest: &str) -> Result<&mut Entry> {
        let [r, g, b] = rgb_words(keyword, rest)?;
        let entry = self.entry(keyword)?;
        entry.text.push_str(&format!("{keyword} {r} {g} {b}\n"));
        Ok(entry)
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

/// The three numbers of a colour. One number means grey, by the MTL specification.
fn rgb_words<'a>(keyword: &str, rest: &'a str) -> Result<[&'a str; 3]> {
    let given: Vec<&str> = words(rest).collect();
    if let [form @ ("spectral" | "xyz"), ..] = given[..] {
        return Err(Error::new(format!("`{keyword} {form}` is not supported"))
            .remedy(format!("write the colour in linear RGB as `{keyword} r g b`")));
    }
    for word in &given {
        number(word)?;
    }
    match given[..] {
        [grey] => Ok([grey; 3]),
        [r, g, b] => Ok([r, g, b]),
        _ => Err(Error::new(format!(
            "`{keyword}` takes 1 or 3 numbers, this one has {}",
            given.len()
        ))
        .remedy(format!("write `{keyword} r g b`"))),
    }
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
    fn grey_is_written_out_for_tobj_and_the_rest_is_left_away() {
        let text = "newmtl a b\r\nKd 0.5\r\nKs what\nd -halo 1\nKe 1 2 3 # lamp\n";
        let (library, warnings) = check(text).unwrap();
        assert_eq!(library.text(), "newmtl a b\nKd 0.5 0.5 0.5\nKe 1 2 3\n");
        assert_eq!((library.entries[0].kd_line, library.entries[0].ke_line), (Some(2), Some(5)));
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
        assert_eq!(library.text(), "newmtl a\nKe 9 9 9\nnewmtl b\n");
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
