use std::io::BufRead;

use super::header::Layout;
use super::vertex::Vertex;
use ply_rs::ply::PropertyAccess;

/// Reads one vertex of an ASCII file. Numbers may be written in any way that Rust, C or PCL writes them (`5.`, `.5`,
/// `nan`, `-inf`), which the grammar of ply-rs does not take.
pub(super) fn read_vertex(
    reader: &mut impl BufRead,
    layout: &Layout,
    line: &mut String,
) -> Result<Vertex, String> {
    next_line(reader, line)?;
    while line.trim_ascii().is_empty() && !layout.columns.is_empty() {
        next_line(reader, line)?;
    }
    // Some exporters put a byte-order mark between the header and the points.
    let mut words = line.trim_start_matches('\u{feff}').split_ascii_whitespace();
    let mut number = || -> Result<f64, String> {
        let word = words
            .next()
            .ok_or("a line has fewer numbers than the header says")?;
        word.parse().map_err(|_| format!("'{word}' is no number"))
    };
    let mut vertex = Vertex::new();
    for column in &layout.columns {
        let value = number()?;
        match column {
            Some(slot) => vertex.put(*slot, value),
            None => (0..value as u64).try_for_each(|_| number().map(drop))?,
        }
    }
    Ok(vertex)
}

/// Reads over the lines of an element that is not wanted.
pub(super) fn skip_lines(reader: &mut impl BufRead, count: usize) -> Result<(), String> {
    let mut line = String::new();
    (0..count).try_for_each(|_| next_line(reader, &mut line))
}

fn next_line(reader: &mut impl BufRead, line: &mut String) -> Result<(), String> {
    line.clear();
    let read = reader.read_line(line).map_err(|error| error.to_string())?;
    if read == 0 {
        Err("the file ends early".into())
    } else {
        Ok(())
    }
}

/// Reads a line of properties, of which those marked are lists, and returns the first list.
pub(super) fn read_list(
    reader: &mut impl BufRead,
    properties: impl Iterator<Item = bool>,
) -> Result<Vec<i64>, String> {
    let mut line = String::new();
    next_line(reader, &mut line)?;
    let mut words = line.split_ascii_whitespace();
    for is_list in properties {
        // What stands before the list may be any number; it is not looked at.
        let count = if is_list { whole(words.next())? } else { 1 };
        let values = (0..count).map(|_| words.next());
        if is_list {
            return values.map(whole).collect();
        }
        values.for_each(drop);
    }
    Err("it has no list of corners".into())
}

fn whole(word: Option<&str>) -> Result<i64, String> {
    let word = word.ok_or("a line has fewer numbers than the header says")?;
    word.parse()
        .map_err(|_| format!("'{word}' is no whole number"))
}
