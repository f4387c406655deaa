//! The program: `ostra`.

fn main() -> std::process::ExitCode {
    ostra::cli::main()
}
