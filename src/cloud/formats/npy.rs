/// An array in NumPy's form (NEP 1, version 1.0), little-endian: `kind` as in `<f4`, the numbers of entries along each
/// axis, and the entries' bytes with the last axis running fastest.
pub(super) fn array(kind: &str, shape: &[usize], entries: &[u8]) -> Vec<u8> {
    let shape: String = shape.iter().map(|along| format!("{along},")).collect();
    let mut head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    // With the ten bytes before it and the line's end the entries begin at a multiple of 64.
    let whole = (10 + head.len() + 1).next_multiple_of(64);
    head.extend(std::iter::repeat_n(' ', whole - 10 - 1 - head.len()));
    head.push('\n');
    let mut bytes = Vec::with_capacity(whole + entries.len());
    bytes.extend_from_slice(b"\x93NUMPY\x01\x00");
    bytes.extend_from_slice(&((whole - 10) as u16).to_le_bytes());
    bytes.extend_from_slice(head.as_bytes());
    bytes.extend_from_slice(entries);
    bytes
}

/// An array of texts: all as wide as the longest, four bytes a letter, ended by zeros.
pub(super) fn texts(texts: &[String]) -> Vec<u8> {
    let width = texts
        .iter()
        .map(|text| text.chars().count())
        .max()
        .unwrap_or(0)
        .max(1);
    let padded = |text: &String| {
        text.chars()
            .map(u32::from)
            .chain(std::iter::repeat(0))
            .take(width)
            .collect::<Vec<_>>()
    };
    let entries: Vec<u8> = texts
        .iter()
        .flat_map(padded)
        .flat_map(u32::to_le_bytes)
        .collect();
    array(&format!("<U{width}"), &[texts.len()], &entries)
}
