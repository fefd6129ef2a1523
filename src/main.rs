//! The `isolux` program; everything it does is in the library.

#[global_allocator]
static ALLOCATOR: isolux::cli::Allocator = isolux::cli::Allocator;

fn main() -> std::process::ExitCode {
    isolux::cli::run()
}
