//! The source files depend on each other without a circle.
//!
//! A file depends on each file whose items it names by a path from `crate`, `super` or `self`. Comments,
//! strings and code for tests do not count. A parent and what lies below it may name each other, for
//! Rust declares a module in its parent. All else is looked at among siblings, each with what lies below
//! it: so no circle hides by passing through a parent.
//!
//! Methods are found by type rather than by path, and escape this test.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// A module's path from the root of the crate, which itself is empty.
type Module = Vec<String>;

/// One module names an item of another.
#[derive(Debug)]
struct Arrow {
    from: Module,
    to: Module,
}

#[test]
fn no_source_files_depend_on_each_other_in_a_circle() {
    let mut sources = BTreeMap::new();
    read_folder(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &[], &mut sources);
    let arrows = arrows(&sources);
    assert!(sources.len() > 50 && arrows.len() > sources.len(), "the sources were read");
    let circle = circle(&arrows);
    assert!(circle.is_empty(), "a circle:\n{}", describe(&circle));
}

#[test]
fn a_circle_is_found_whichever_way_the_paths_are_written() {
    let b = ("b", "pub struct B; impl B { fn f() { super::a::f() } }");
    let exports = ("exports", "pub use crate::b::B;");
    for a in [
        "use super::b::B;",
        "use crate::{other::X, b::{self, B as Renamed}};",
        "fn f() -> crate::b::B { todo!() }",
        "mod inner { use super::super::b::B; }",
        "use crate::exports::B;",
        "#[cfg(test)] mod tests { fn f() {} } use super::b::B;",
        "const QUOTE: char = '\"'; fn f<'a>(_: &'a crate::b::B) {}",
    ] {
        assert_eq!(describe_small(&[("a", a), b, exports]), "a → b\nb → a\n", "{a}");
    }
}

#[test]
fn a_circle_through_a_parent_is_found() {
    let files = [("a", "pub mod deep;"), ("a deep", "use crate::b;"), ("b", "use crate::a::Item;")];
    assert_eq!(describe_small(&files), "a::deep → b\nb → a\n");
}

#[test]
fn tests_comments_strings_and_parents_make_no_circle() {
    let b = ("b", "use super::a::A;");
    for a in [
        "// use super::b::B;",
        "/* /* */ use super::b::B; */",
        "const S: &str = \"\\\" crate::b::B\";",
        "const S: &str = r#\"\" crate::b::B\"#;",
        "#[cfg(test)]\nmod tests { use crate::b::B; }",
        "#[cfg(test)]\nuse crate::b::B;",
        "pub mod below; pub use below::Below;",
    ] {
        assert_eq!(describe_small(&[("a", a), b, ("a below", "use super::A;")]), "", "{a}");
    }
}

#[test]
fn files_for_tests_make_no_circle() {
    let a = ("a", "#[cfg(test)]\n#[allow(missing_docs)]\npub(crate) mod tests;");
    let files = [a, ("a tests", "use crate::b::B;"), ("b", "use crate::a::A;")];
    assert_eq!(describe_small(&files), "");
}

/// `cargo afl build --locked` fails otherwise.
#[test]
fn the_fuzzers_lock_file_names_every_crate_that_isolux_needs() {
    let read = |file: &str| -> toml::Table {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        toml::from_str(&fs::read_to_string(path).unwrap()).unwrap()
    };
    let (manifest, lock) = (read("Cargo.toml"), read("tests/fuzz/Cargo.lock"));
    let packages = lock["package"].as_array().unwrap();
    let isolux = packages.iter().find(|package| package["name"].as_str() == Some("isolux"));
    let locked = isolux.unwrap()["dependencies"].as_array().unwrap();
    let is_locked = |name: &str| {
        locked.iter().any(|entry| entry.as_str().unwrap().split(' ').next() == Some(name))
    };
    let mut tables = vec![&manifest["dependencies"]];
    tables.extend(manifest["target"].as_table().unwrap().values().map(|t| &t["dependencies"]));
    for (name, crate_) in tables.into_iter().flat_map(|table| table.as_table().unwrap()) {
        let is_optional = crate_.get("optional").is_some_and(|o| o.as_bool() == Some(true));
        assert!(is_optional || is_locked(name), "{name}");
    }
}

fn describe_small(files: &[(&str, &str)]) -> String {
    let module = |name: &str| name.split(' ').map(String::from).collect();
    let source = |&(name, text): &(&str, &str)| (module(name), tokens(text));
    describe(&circle(&arrows(&files.iter().map(source).collect())))
}

fn describe(circle: &[&Arrow]) -> String {
    circle
        .iter()
        .map(|arrow| format!("{} → {}\n", arrow.from.join("::"), arrow.to.join("::")))
        .collect()
}

fn below(module: &[String], name: &str) -> Module {
    [module, &[name.to_string()]].concat()
}

fn read_folder(folder: &Path, module: &[String], sources: &mut BTreeMap<Module, Vec<String>>) {
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("a file or folder").path();
        let name = path.file_stem().expect("a name").to_str().expect("UTF-8");
        let below = below(module, name);
        if path.is_dir() {
            read_folder(&path, &below, sources);
        } else if path.extension().is_some_and(|e| e == "rs") && name != "main" {
            let module = if ["lib", "mod"].contains(&name) { module.to_vec() } else { below };
            sources.insert(module, tokens(&fs::read_to_string(&path).expect("a source file")));
        }
    }
}

/// Names, `::` and single other characters, without comments, literals and space.
fn tokens(text: &str) -> Vec<String> {
    let mut tokens = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let is_name = |c: char| c.is_alphanumeric() || c == '_';
        let name = rest.find(|c| !is_name(c)).unwrap_or(rest.len());
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            block_comment(rest)
        } else if let Some(raw) = raw_string(rest) {
            raw
        } else if first == '"' {
            quoted(rest, '"')
        } else if first == '\'' {
            // A lifetime has no second quote.
            let second = rest[1..].chars().next().map_or(1, |c| 1 + c.len_utf8());
            let is_literal = rest[1..].starts_with('\\') || rest[second..].starts_with('\'');
            if is_literal { quoted(rest, '\'') } else { 1 }
        } else if first.is_whitespace() {
            first.len_utf8()
        } else {
            let colons = if rest.starts_with("::") { 2 } else { first.len_utf8() };
            let length = if name > 0 { name } else { colons };
            tokens.push(rest[..length].to_string());
            length
        };
        rest = &rest[length..];
    }
    tokens
}

/// Length of the comment at the front, those inside it included.
fn block_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    loop {
        let step = match text.as_bytes()[at..] {
            [b'/', b'*', ..] => 1,
            [b'*', b'/', ..] => -1,
            _ => 0,
        };
        depth += step;
        at += if step == 0 { 1 } else { 2 };
        if depth == 0 || at >= text.len() {
            return at;
        }
    }
}

/// Length of the raw string at the front.
fn raw_string(text: &str) -> Option<usize> {
    let hashes = text.strip_prefix('r')?.chars().take_while(|&c| c == '#').count();
    let content = text[1 + hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    Some(2 + hashes + content.find(&end)? + end.len())
}

/// Length of the literal at the front, both quotes included.
fn quoted(text: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        if c == quote && !escaped {
            return at + 1;
        }
        escaped = c == '\\' && !escaped;
    }
    text.len()
}

fn arrows(sources: &BTreeMap<Module, Vec<String>>) -> Vec<Arrow> {
    let mut files = BTreeMap::new();
    let mut tests = BTreeSet::new();
    for (module, tokens) in sources {
        let kept = without_tests(tokens, module, &mut tests);
        files.insert(module.clone(), paths(&kept, module));
    }
    files.retain(|module, _| !tests.iter().any(|test| module.starts_with(test)));
    let arrow =
        |from: &Module, path: &Named| Arrow { from: from.clone(), to: resolve(&files, path) };
    files.iter().flat_map(|(from, paths)| paths.iter().map(move |p| arrow(from, p))).collect()
}

/// The tokens that count. A module for tests in a file of its own is added to `tests`.
fn without_tests(tokens: &[String], module: &Module, tests: &mut BTreeSet<Module>) -> Vec<String> {
    let mut kept = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        if !tokens[at..].starts_with(&["#", "[", "cfg", "(", "test", ")", "]"].map(String::from)) {
            kept.push(tokens[at].clone());
            at += 1;
            continue;
        }
        let start = at;
        let mut depth = 0;
        loop {
            match tokens[at].as_str() {
                "{" => depth += 1,
                "}" => depth -= 1,
                _ => {}
            }
            at += 1;
            if depth == 0 && [";", "}"].contains(&tokens[at - 1].as_str()) {
                break;
            }
        }
        if let [.., keyword, name, end] = &tokens[start..at]
            && (keyword.as_str(), end.as_str()) == ("mod", ";")
        {
            tests.insert(below(module, name));
        }
    }
    kept
}

/// A path from the root of the crate, and the name that a `use` gives it in its module.
struct Named {
    path: Module,
    name: String,
}

/// All paths in a file that begin with `crate`, `super`, `self`, or in a `use` with a module below.
fn paths(tokens: &[String], file: &Module) -> Vec<Named> {
    let mut paths = Vec::new();
    // Modules inside the file, and at which depth of braces each of them begins.
    let mut module = file.clone();
    let mut begins = Vec::new();
    let mut depth = 0;
    let mut at = 0;
    while at < tokens.len() {
        let token = |ahead: usize| tokens.get(at + ahead).map_or("", String::as_str);
        match token(0) {
            "pub" if token(1) == "(" => {
                while tokens[at] != ")" {
                    at += 1;
                }
            }
            "mod" if token(2) == "{" => {
                module.push(token(1).to_string());
                begins.push(depth);
            }
            "{" => depth += 1,
            "}" => {
                depth -= 1;
                if begins.last() == Some(&depth) {
                    begins.pop();
                    module.pop();
                }
            }
            "use" => {
                at += 1;
                tree(tokens, &mut at, &module, &mut paths);
                continue;
            }
            "crate" | "super" | "self" if token(1) == "::" => {
                tree(tokens, &mut at, &module, &mut paths);
                paths.last_mut().expect("the path").name.clear();
                continue;
            }
            _ => {}
        }
        at += 1;
    }
    paths
}

/// Adds the path that begins at `at`, or all paths if it branches into braces.
fn tree(tokens: &[String], at: &mut usize, before: &Module, paths: &mut Vec<Named>) {
    let mut path = before.clone();
    let mut name = String::new();
    loop {
        match tokens[*at].as_str() {
            "{" => {
                *at += 1;
                while tokens[*at] != "}" {
                    tree(tokens, at, &path, paths);
                    if tokens[*at] == "," {
                        *at += 1;
                    }
                }
                *at += 1;
                return;
            }
            "crate" => path.clear(),
            "super" => drop(path.pop()),
            "self" | "*" => {}
            segment => {
                path.push(segment.to_string());
                name = segment.to_string();
            }
        }
        *at += 1;
        if tokens[*at] != "::" {
            break;
        }
        *at += 1;
    }
    if tokens[*at] == "as" {
        name = tokens[*at + 1].clone();
        *at += 2;
    }
    paths.push(Named { path, name });
}

/// The file that holds what a path names: a module may have it from elsewhere.
fn resolve(files: &BTreeMap<Module, Vec<Named>>, named: &Named) -> Module {
    let mut module = Module::new();
    for segment in &named.path {
        let below = below(&module, segment);
        let is_module = files.keys().any(|file| file.starts_with(&below));
        if is_module {
            module = below;
            continue;
        }
        let is_import = |path: &&Named| path.name == *segment && !path.path.starts_with(&below);
        let imported = files.get(&module).into_iter().flatten().find(is_import);
        return imported.map_or(module, |import| resolve(files, import));
    }
    module
}

/// A circle among siblings, each taken with what lies below it; empty if there is none.
fn circle(arrows: &[Arrow]) -> Vec<&Arrow> {
    let mut graph: BTreeMap<&[String], BTreeMap<&[String], &Arrow>> = BTreeMap::new();
    for arrow in arrows {
        let common = arrow.from.iter().zip(&arrow.to).take_while(|(a, b)| a == b).count();
        if common < arrow.from.len() && common < arrow.to.len() {
            let (from, to) = (&arrow.from[..=common], &arrow.to[..=common]);
            graph.entry(from).or_default().entry(to).or_insert(arrow);
        }
    }
    // What leads nowhere is on no circle. What is left when nothing does is empty or leads on forever.
    loop {
        let before = graph.len();
        let alive: BTreeSet<&[String]> = graph.keys().copied().collect();
        graph.values_mut().for_each(|next| next.retain(|to, _| alive.contains(to)));
        graph.retain(|_, next| !next.is_empty());
        if graph.len() == before {
            break;
        }
    }
    let Some(mut at) = graph.keys().next().copied() else { return Vec::new() };
    let (mut visited, mut way) = (Vec::new(), Vec::new());
    while !visited.contains(&at) {
        visited.push(at);
        let (next, arrow) = graph[at].first_key_value().expect("it leads on");
        way.push(*arrow);
        at = next;
    }
    let start = visited.iter().position(|&module| module == at).expect("visited");
    way.split_off(start)
}
