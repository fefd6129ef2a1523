//! The `isolux` program; everything it does is in the library.

fn main() -> std::process::ExitCode {
    isolux::cli::run()
}
