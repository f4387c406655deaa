//! The program: `ostra`.

fn main() {}
