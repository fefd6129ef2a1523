//! Gives a reader of isolux what AFL++ finds.
//!
//! ```text
//! isolux-fuzz seeds FOLDER         writes what fuzzing begins with: FOLDER/TARGET/N and FOLDER/TARGET.dict
//! isolux-fuzz TARGET FOLDER        for AFL++; or one input from standard input. FOLDER is for the reader's files
//! ```

#[path = "../../suite/fuzz/seeds.rs"]
mod seeds;
#[path = "../../suite/fuzz/targets.rs"]
mod targets;

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

fn main() {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [name, folder] = &arguments[..] else {
        eprintln!("usage: isolux-fuzz seeds|TARGET FOLDER");
        return;
    };
    let folder = PathBuf::from(folder);
    if name == "seeds" {
        return write_seeds(&folder);
    }
    let target = targets::target(name).expect("the name of a target");
    fs::create_dir_all(&folder).expect("a folder");
    afl::fuzz!(|bytes: &[u8]| target.run(&folder, bytes));
}

fn write_seeds(folder: &Path) {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    for target in &targets::TARGETS {
        fs::create_dir_all(folder).expect("a folder");
        fs::write(folder.join(format!("{}.dict", target.name)), target.dictionary).expect("a file");
        let folder = folder.join(target.name);
        fs::create_dir_all(&folder).expect("a folder");
        for (number, seed) in seeds::seeds(target.name, &scenes).iter().enumerate() {
            fs::write(folder.join(number.to_string()), seed).expect("a file");
        }
    }
}
