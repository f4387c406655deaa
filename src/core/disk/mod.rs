//! Files that are written whole or not at all, and files that are read without waiting for another process.

mod atomic;
mod fault;
mod in_place;
mod leftovers;
mod open;
mod second_name;
mod system_files;
mod unfinished;

pub use atomic::{AtomicFile, WorkFolder, write};
pub use fault::{fault, read_fault, write_fault};
pub use in_place::{is_still_at, open_in_place};
pub use leftovers::{is_temporary, remove_leftovers};
pub use open::{
    decode_text, open_regular, read_regular, read_regular_up_to, read_text, read_text_up_to,
    skip_mark,
};
pub use second_name::link;
pub use system_files::is_system_file;
pub use unfinished::{Unfinished, remove_unfinished};
