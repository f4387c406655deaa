//! Program `ostra`: the command line, which also opens the window.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
