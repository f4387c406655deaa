use std::collections::BTreeMap;

use crate::masks::MaskError;

/// Splits words into the pieces that BERT (uncased) knows, by a vocabulary of one piece a line.
///
/// Accents are taken off the Latin letters of European languages; other accented letters stay as they are.
#[derive(Debug, Clone)]
pub struct Tokenizer {
    ids: BTreeMap<String, i64>,
    /// What stands at the start, at the end, for what is not known, and between phrases.
    pub(super) start: i64,
    pub(super) end: i64,
    unknown: i64,
    pub(super) stop: i64,
}

/// A word of more letters is unknown.
const LONGEST: usize = 100;

/// Plain letters, each before its accented forms.
const ACCENTS: [&str; 22] = [
    "aàáâãäåāăą",
    "cçćĉċč",
    "dď",
    "eèéêëēĕėęě",
    "gĝğġģ",
    "hĥ",
    "iìíîïĩīĭį",
    "jĵ",
    "kķ",
    "lĺļľ",
    "nñńņň",
    "oòóôõöōŏő",
    "rŕŗř",
    "sśŝşš",
    "tţť",
    "uùúûüũūŭůűų",
    "wŵ",
    "yýÿŷ",
    "zźżž",
    "aǎ",
    "iǐ",
    "oǒ",
];

impl Tokenizer {
    /// From the text of a `vocab.txt`: the number of a line, from 0, is the id of its piece.
    ///
    /// # Errors
    /// [`MaskError::Network`] where it lacks what every caption needs.
    pub fn new(vocabulary: &str) -> Result<Self, MaskError> {
        let ids: BTreeMap<String, i64> = vocabulary.lines().map(|piece| piece.trim_end().to_owned()).zip(0..).collect();
        let id = |piece: &str| {
            let missing =
                || MaskError::Network(format!("the vocabulary has no '{piece}'; take vocab.txt of BERT uncased"));
            ids.get(piece).copied().ok_or_else(missing)
        };
        let (start, end, unknown, stop) = (id("[CLS]")?, id("[SEP]")?, id("[UNK]")?, id(".")?);
        Ok(Self { ids, start, end, unknown, stop })
    }

    /// Ids of the pieces of a text.
    #[must_use]
    pub fn ids(&self, text: &str) -> Vec<i64> {
        words(text).iter().flat_map(|word| self.pieces(word)).collect()
    }

    /// The longest piece that a word begins with, then the longest that the rest begins with, and so on.
    fn pieces(&self, word: &str) -> Vec<i64> {
        let letters: Vec<char> = word.chars().collect();
        let (mut found, mut at) = (Vec::new(), 0);
        while at < letters.len() && letters.len() <= LONGEST {
            let piece = |end: usize| {
                let before = if at > 0 { "##" } else { "" };
                let letters: String = letters[at..end].iter().collect();
                Some((end, *self.ids.get(&format!("{before}{letters}"))?))
            };
            let Some((end, id)) = (at + 1..=letters.len()).rev().find_map(piece) else { break };
            found.push(id);
            at = end;
        }
        if at == letters.len() { found } else { vec![self.unknown] }
    }
}

/// Words in lower case; punctuation and Chinese characters are words of their own.
fn words(text: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    for letter in text.chars().flat_map(char::to_lowercase) {
        let letter = plain(letter);
        if letter.is_whitespace() {
            words.push(String::new());
        } else if is_punctuation(letter) || is_chinese(letter) {
            words.extend([letter.to_string(), String::new()]);
        } else if let Some(word) = words.last_mut().filter(|_| !is_dropped(letter)) {
            word.push(letter);
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

fn plain(letter: char) -> char {
    let of = |forms: &&&str| letter > '\u{7f}' && forms.contains(letter);
    ACCENTS.iter().find(of).and_then(|forms| forms.chars().next()).unwrap_or(letter)
}

/// ASCII symbols count as punctuation too.
fn is_punctuation(letter: char) -> bool {
    letter.is_ascii_punctuation()
        || matches!(letter, '¡' | '§' | '«' | '¶' | '·' | '»' | '¿' | '\u{2010}'..='\u{2027}' | '\u{2030}'..='\u{205e}')
        || matches!(letter, '\u{3001}'..='\u{3003}' | '\u{3008}'..='\u{3011}')
}

fn is_chinese(letter: char) -> bool {
    matches!(letter, '\u{4e00}'..='\u{9fff}' | '\u{3400}'..='\u{4dbf}' | '\u{f900}'..='\u{faff}' | '\u{20000}'..='\u{2ceaf}')
}

/// Control characters, and accents that stand by themselves.
fn is_dropped(letter: char) -> bool {
    letter.is_control() || matches!(letter, '\u{300}'..='\u{36f}' | '\u{200b}'..='\u{200f}' | '\u{feff}' | '\u{fffd}')
}
