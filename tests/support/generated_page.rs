//! The parts of the book that are generated from the program.

use std::fs;
use std::path::Path;

/// Checks the part of a page between two lines `<!-- generated: SUBJECT -->`, or writes it if
/// `OSTRA_UPDATE_BOOK` is set.
///
/// # Panics
///
/// If the part differs from `generated`.
pub fn check(page: &str, subject: &str, generated: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("docs/book/src")
        .join(page);
    let mark = format!("<!-- generated: {subject} -->\n");
    let text = fs::read_to_string(&path).unwrap();
    let parts: Vec<&str> = text.split(&mark).collect();
    let [before, now, after] = parts[..] else {
        panic!("{page} has a mark at both ends of its generated part");
    };
    if std::env::var_os("OSTRA_UPDATE_BOOK").is_some() {
        fs::write(&path, [before, generated, after].join(&mark)).unwrap();
    } else {
        assert!(
            now == generated,
            "run `OSTRA_UPDATE_BOOK=1 cargo test book` to write {page} again"
        );
    }
}
