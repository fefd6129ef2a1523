//! Finds the installed Embree 4 for feature `embree`; without the feature, does nothing.
//!
//! The structs that cross the boundary are taken from the installed header by bindgen, since their
//! layout depends on the options that Embree was built with (`src/oracle/layout.rs` says more).

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "embree")]
    if let Err(message) = embree::configure() {
        println!("cargo::error={message}");
    }
}

#[cfg(feature = "embree")]
mod embree {
    use std::path::{Path, PathBuf};
    use std::{env, fs, panic};

    const WANTED: &str = "Embree 4 (>= 4.0, < 5)";
    const REMEDY: &str = "install libembree-dev and libclang-dev (tests/setup does), or set \
         EMBREE_DIR to a folder that holds include/embree4 and lib";

    /// The structs that Embree reads or writes through a pointer, and what names the version.
    const TYPES: &str = "RTCRay(4|8|16)?|RTCRayHit(4|8|16)?|RTCRayQueryContext";
    const CONSTANTS: &str = "RTC_VERSION_(MAJOR|MINOR)";
    /// Newer than the headers in embree4-sys, and absent before Embree 4.3.3.
    const LAST_ERROR_MESSAGE: &str = "rtcGetDeviceLastErrorMessage";

    pub(crate) fn configure() -> Result<(), String> {
        println!("cargo::rerun-if-env-changed=EMBREE_DIR");
        println!("cargo::rustc-check-cfg=cfg(embree_last_error_message)");
        let (include, version) = find_include()?;
        let library = find_library(&version)?;
        println!("cargo::rerun-if-changed={}", include.join("embree4").display());
        println!("cargo::rerun-if-changed={}", library.display());
        generate_layouts(&include, &version)?;
        link(&library);
        Ok(())
    }

    /// Where Embree may be: only `EMBREE_DIR` if that is set, so that nothing else is mixed in.
    fn roots() -> Vec<PathBuf> {
        match env::var_os("EMBREE_DIR") {
            Some(root) => vec![root.into()],
            None => vec!["/usr".into(), "/usr/local".into()],
        }
    }

    /// Debian's name for the folders of one architecture, below `lib` and `include`.
    fn multiarch() -> String {
        env::var("CARGO_CFG_TARGET_ARCH").expect("cargo sets it") + "-linux-gnu"
    }

    /// The folder below which `embree4/rtcore.h` lies, of a version that fits, and that version.
    fn find_include() -> Result<(PathBuf, String), String> {
        let folders: Vec<PathBuf> = roots()
            .iter()
            .flat_map(|root| [root.join("include"), root.join("include").join(multiarch())])
            .collect();
        // Older ones are looked for too, since "found 3.13.5" helps more than "found nothing".
        for name in ["embree4", "embree3", "embree2"] {
            for folder in &folders {
                let Ok(config) = fs::read_to_string(folder.join(name).join("rtcore_config.h"))
                else {
                    continue;
                };
                let version = version(&config);
                if version.starts_with("4.") {
                    return Ok((folder.clone(), version));
                }
                let found = folder.join(name).display().to_string();
                return Err(missing(&format!("found {version} in {found}")));
            }
        }
        Err(missing(&format!("found no headers in {}", list(&folders))))
    }

    /// `RTC_VERSION_MAJOR`, `_MINOR` and `_PATCH` of an `rtcore_config.h`, such as `4.3.3`.
    fn version(config: &str) -> String {
        let number = |part| {
            let define = format!("#define RTC_VERSION_{part} ");
            config.lines().find_map(|line| line.strip_prefix(&define)).map_or("?", str::trim)
        };
        ["MAJOR", "MINOR", "PATCH"].map(number).join(".")
    }

    /// The one message for everything that may be missing.
    fn missing(found: &str) -> String {
        format!("feature `embree` wants {WANTED} and libclang, but {found}; {REMEDY}")
    }

    fn find_library(version: &str) -> Result<PathBuf, String> {
        let folders: Vec<PathBuf> = roots()
            .iter()
            .map(|root| root.join("lib"))
            .flat_map(|lib| [lib.join(multiarch()), lib.with_file_name("lib64"), lib])
            .collect();
        folders
            .iter()
            .flat_map(|folder| [folder.join("libembree4.so"), folder.join("libembree4.dylib")])
            .find(|file| file.exists())
            .ok_or_else(|| {
                let folders = list(&folders);
                missing(&format!("found headers of {version} without libembree4.so in {folders}"))
            })
    }

    fn list(folders: &[PathBuf]) -> String {
        folders.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ")
    }

    /// Writes `embree.rs`, which `src/oracle/layout.rs` includes.
    fn generate_layouts(include: &Path, version: &str) -> Result<(), String> {
        if !has_libclang() {
            return Err(missing(&format!("found Embree {version} without libclang")));
        }
        let header = include.join("embree4/rtcore.h");
        let bindings = bindgen::Builder::default()
            .header(header.display().to_string())
            .clang_arg(format!("-I{}", include.display()))
            .allowlist_type(TYPES)
            .allowlist_var(CONSTANTS)
            .allowlist_function(LAST_ERROR_MESSAGE)
            .derive_default(true)
            .layout_tests(true)
            .formatter(bindgen::Formatter::None)
            .generate()
            .map_err(|error| {
                format!("bindgen cannot read {}: {error}; {REMEDY}", header.display())
            })?
            .to_string();
        if bindings.contains(LAST_ERROR_MESSAGE) {
            println!("cargo::rustc-cfg=embree_last_error_message");
        }
        let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it")).join("embree.rs");
        fs::write(&out, bindings)
            .map_err(|error| format!("cannot write {}: {error}", out.display()))
    }

    /// Bindgen panics when it does not find libclang; a message is kinder.
    fn has_libclang() -> bool {
        panic::set_hook(Box::new(|_| ()));
        let found = panic::catch_unwind(bindgen::clang_version).is_ok();
        let _ = panic::take_hook();
        found
    }

    fn link(library: &Path) {
        let folder = library.parent().expect("a file lies in a folder").display();
        println!("cargo::rustc-link-search=native={folder}");
        println!("cargo::rustc-link-lib=dylib=embree4");
        // The loader knows the system's folders, but not the user's own.
        if env::var_os("EMBREE_DIR").is_some() {
            println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}");
        }
    }
}
