//! The program: `ostra`.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
