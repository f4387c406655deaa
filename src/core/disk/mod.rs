//! Atomic file writing, and reading of files without waiting for another process.

mod atomic;
mod bounded;
mod fault;
mod in_place;
mod open;
mod temporary;

pub use atomic::{AtomicFile, WorkFolder, link, write};
pub use bounded::{KeptFile, kept_files, mark_used, remove_beyond};
pub use fault::{fault, read_fault, write_fault};
pub use in_place::open_in_place;
pub use open::{
    decode_text, is_still_at, is_system_file, open_regular, read_regular, read_regular_up_to,
    read_text, read_text_up_to, skip_mark,
};
pub use temporary::{Unfinished, is_temporary, remove_leftovers, remove_unfinished};
