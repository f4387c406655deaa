//! Damage to a file: a few changes of the kinds that parsers fail on.

use bolero::TypeGenerator;

use crate::harness::Seed;

/// The seed that is damaged, and its changes.
#[derive(Debug, Clone, TypeGenerator)]
pub struct Damage {
    seed: u16,
    first: Change,
    more: Vec<Change>,
    /// Number of changes of `more` to apply, modulo 6.
    ///
    /// Most inputs should stay close to a valid file.
    count: u8,
}

/// One change.
///
/// Positions are fractions of the file's length, in 65536ths.
#[derive(Debug, Clone, TypeGenerator)]
enum Change {
    Set {
        at: u16,
        value: u8,
    },
    FlipBit {
        at: u16,
        bit: u8,
    },
    Insert {
        at: u16,
        bytes: [u8; 4],
    },
    Remove {
        at: u16,
        count: u8,
    },
    Truncate {
        at: u16,
    },
    Repeat {
        at: u16,
        count: u8,
        times: u8,
    },
    Word {
        at: u16,
        word: u8,
        big_endian: bool,
    },
    Token {
        at: u16,
        token: u8,
    },
    Splice {
        at: u16,
        from: u16,
        other: u16,
        count: u8,
    },
    Replace {
        bytes: Vec<u8>,
    },
}

/// Numbers at the limits of integers and buffers.
const WORDS: [u64; 10] = [
    0,
    1,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
    0x0001_0000,
    0x4000_0000,
    65535,
];

/// Replacements for a number or a word of a text.
const TOKENS: [&str; 22] = [
    "-1",
    "0",
    "NaN",
    "nan",
    "inf",
    "-inf",
    "Infinity",
    "1e308",
    "1e-320",
    "4294967296",
    "9223372036854775807",
    "99999999999999999999",
    "65536",
    "null",
    "true",
    "[]",
    "{}",
    "\"\"",
    "../../x",
    "\u{feff}",
    "\u{1b}[31m",
    "é",
];

/// Returns one of the seeds with the damage applied.
pub fn damaged(seeds: &[Seed], damage: &Damage) -> Seed {
    let mut seed = seeds[damage.seed as usize % seeds.len()].clone();
    let more = damage.more.iter().take(damage.count as usize % 6);
    for change in std::iter::once(&damage.first).chain(more) {
        apply(&mut seed.bytes, change, seeds);
    }
    seed
}

fn apply(bytes: &mut Vec<u8>, change: &Change, seeds: &[Seed]) {
    let index = |at: u16, bytes: &[u8]| at as usize * bytes.len() / 65536;
    match change {
        Change::Set { at, value } => {
            let at = index(*at, bytes);
            bytes
                .get_mut(at)
                .into_iter()
                .for_each(|byte| *byte = *value);
        }
        Change::FlipBit { at, bit } => {
            let at = index(*at, bytes);
            bytes
                .get_mut(at)
                .into_iter()
                .for_each(|byte| *byte ^= 1 << (bit % 8));
        }
        Change::Insert { at, bytes: new } => {
            let at = index(*at, bytes);
            bytes.splice(at..at, new.iter().copied());
        }
        Change::Remove { at, count } => {
            let at = index(*at, bytes);
            bytes.drain(at..(at + *count as usize).min(bytes.len()));
        }
        Change::Truncate { at } => bytes.truncate(index(*at, bytes)),
        Change::Repeat { at, count, times } => {
            let at = index(*at, bytes);
            let piece =
                bytes[at..(at + *count as usize).min(bytes.len())].repeat(*times as usize % 32);
            bytes.splice(at..at, piece);
        }
        Change::Word {
            at,
            word,
            big_endian,
        } => {
            let at = index(*at, bytes);
            let value = WORDS[*word as usize % WORDS.len()];
            let width = if value > u64::from(u32::MAX) { 8 } else { 4 };
            let encoded = if *big_endian {
                value.to_be_bytes()[8 - width..].to_vec()
            } else {
                value.to_le_bytes()[..width].to_vec()
            };
            bytes[at..]
                .iter_mut()
                .zip(encoded)
                .for_each(|(byte, new)| *byte = new);
        }
        Change::Token { at, token } => {
            let at = index(*at, bytes);
            let is_part = |byte: &u8| byte.is_ascii_alphanumeric() || b"._-+".contains(byte);
            let start = bytes[..at]
                .iter()
                .rposition(|byte| !is_part(byte))
                .map_or(0, |before| before + 1);
            let end = bytes[at..]
                .iter()
                .position(|byte| !is_part(byte))
                .map_or(bytes.len(), |length| at + length);
            bytes.splice(start..end, TOKENS[*token as usize % TOKENS.len()].bytes());
        }
        Change::Splice {
            at,
            from,
            other,
            count,
        } => {
            let other = &seeds[*other as usize % seeds.len()].bytes;
            let from = index(*from, other);
            let piece = other[from..(from + *count as usize).min(other.len())].to_vec();
            let at = index(*at, bytes);
            bytes.splice(at..at, piece);
        }
        Change::Replace { bytes: new } => bytes.clone_from(new),
    }
}
