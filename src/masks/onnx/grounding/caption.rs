use tokenizers::Tokenizer as WordPieces;
use tokenizers::models::wordpiece::WordPiece;
use tokenizers::normalizers::bert::BertNormalizer;
use tokenizers::pre_tokenizers::bert::BertPreTokenizer;

use crate::MaskError;

/// Splits text into the pieces of BERT (uncased), from a vocabulary with one piece per line.
#[derive(Debug, Clone)]
pub struct Tokenizer {
    pieces: WordPieces,
    /// Tokens at the start, at the end, and between phrases.
    pub(super) start: i64,
    pub(super) end: i64,
    pub(super) stop: i64,
}

impl Tokenizer {
    /// Creates a tokenizer from the text of a `vocab.txt`.
    ///
    /// The id of a piece is its line number, from 0.
    ///
    /// # Errors
    /// [`MaskError::Network`] if a token that every caption needs is missing.
    pub fn new(vocabulary: &str) -> Result<Self, MaskError> {
        let broken =
            |what: &str| MaskError::Network(format!("{what}; take vocab.txt of BERT uncased"));
        let unread =
            |error: tokenizers::Error| broken(&format!("the vocabulary cannot be used ({error})"));
        let ids = WordPiece::read_bytes(vocabulary.as_bytes()).map_err(unread)?;
        let id = |piece: &str| {
            let found = ids.get(piece).copied().map(i64::from);
            found.ok_or_else(|| broken(&format!("the vocabulary has no '{piece}'")))
        };
        let (start, end, stop, _) = (id("[CLS]")?, id("[SEP]")?, id(".")?, id("[UNK]")?);
        let mut pieces = WordPieces::new(WordPiece::builder().vocab(ids).build().map_err(unread)?);
        pieces
            .with_normalizer(Some(BertNormalizer::default()))
            .map_err(unread)?;
        pieces.with_pre_tokenizer(Some(BertPreTokenizer));
        Ok(Self {
            pieces,
            start,
            end,
            stop,
        })
    }

    /// Returns the ids of the pieces of a text.
    ///
    /// # Errors
    /// [`MaskError::Request`] for a text that cannot be split.
    pub fn ids(&self, text: &str) -> Result<Vec<i64>, MaskError> {
        let unfit = |error: tokenizers::Error| {
            MaskError::Request(format!("'{text}' cannot be read ({error})"))
        };
        let split = self.pieces.encode_fast(text, false).map_err(unfit)?;
        Ok(split.get_ids().iter().copied().map(i64::from).collect())
    }
}

/// Phrases as one text for the network, each ended by a full stop.
///
/// A token attends only to tokens of its own phrase.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caption {
    /// Ids of the tokens, including start and end.
    pub ids: Vec<i64>,
    /// Position of each token within its phrase, from 0.
    pub positions: Vec<i64>,
    /// Phrase index of each token, full stop included; `None` for start and end.
    pub phrases: Vec<Option<usize>>,
}

impl Caption {
    /// Maximum number of tokens that the network accepts.
    pub const MOST: usize = 256;

    /// Builds the caption of some phrases.
    ///
    /// # Errors
    /// [`MaskError::Request`] if there is no phrase or too many tokens, or if a phrase is empty or
    /// contains a full stop or question mark.
    pub fn new(tokenizer: &Tokenizer, phrases: &[String]) -> Result<Self, MaskError> {
        if phrases.is_empty() {
            return Err(MaskError::Request(
                "there is nothing to search for; enter one or more words".into(),
            ));
        }
        let mut caption = Self {
            ids: Vec::new(),
            positions: Vec::new(),
            phrases: Vec::new(),
        };
        caption.push(&[tokenizer.start], None);
        for (number, phrase) in phrases.iter().enumerate() {
            let plain = phrase.trim().trim_end_matches('.');
            let mut ids = tokenizer.ids(plain)?;
            if ids.is_empty() || plain.contains(['.', '?']) {
                let text = format!(
                    "'{phrase}' cannot be searched for; enter a few words without full stop or question mark"
                );
                return Err(MaskError::Request(text));
            }
            ids.push(tokenizer.stop);
            caption.push(&ids, Some(number));
        }
        caption.push(&[tokenizer.end], None);
        let count = caption.ids.len();
        if count > Self::MOST {
            let text = format!(
                "the phrases make {count} tokens, {} can be looked for at once; give fewer",
                Self::MOST
            );
            return Err(MaskError::Request(text));
        }
        Ok(caption)
    }

    fn push(&mut self, ids: &[i64], phrase: Option<usize>) {
        self.ids.extend(ids);
        self.positions.extend((0..).take(ids.len()));
        self.phrases.extend(ids.iter().map(|_| phrase));
    }

    /// Returns the attention mask, row by row.
    ///
    /// It is 1 where the row's token attends to the column's, else 0.
    #[must_use]
    pub fn attention(&self) -> Vec<i64> {
        let count = self.ids.len();
        let attends = |at: usize| {
            let (row, column) = (at / count, at % count);
            let attends = row == column
                || (self.phrases[row].is_some() && self.phrases[row] == self.phrases[column]);
            i64::from(attends)
        };
        (0..count * count).map(attends).collect()
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Deserialize)]
    struct Reference {
        vocabulary: Vec<String>,
        texts: Vec<(String, Vec<i64>)>,
        captions: Vec<CaptionReference>,
    }

    #[derive(Deserialize)]
    struct CaptionReference {
        phrases: Vec<String>,
        ids: Vec<i64>,
        positions: Vec<i64>,
        attention: Vec<Vec<i64>>,
    }

    fn reference() -> (Reference, Tokenizer) {
        let text = include_str!(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../tests/parity/words.json"
        ));
        let reference: Reference = serde_json::from_str(text).unwrap();
        let tokenizer = Tokenizer::new(&reference.vocabulary.join("\n")).unwrap();
        (reference, tokenizer)
    }

    #[test]
    fn tokens_match_the_reference() {
        let (reference, tokenizer) = reference();
        for (text, ids) in &reference.texts {
            assert_eq!(tokenizer.ids(text).unwrap(), *ids, "{text:?}");
        }
        assert!(reference.texts.len() > 10);
    }

    #[test]
    fn captions_match_the_reference() {
        let (reference, tokenizer) = reference();
        for expected in &reference.captions {
            let caption = Caption::new(&tokenizer, &expected.phrases).unwrap();
            assert_eq!(
                (&caption.ids, &caption.positions),
                (&expected.ids, &expected.positions)
            );
            assert_eq!(
                caption.attention(),
                expected.attention.concat(),
                "{:?}",
                expected.phrases
            );
        }
    }

    #[test]
    fn empty_and_invalid_phrases_are_rejected() {
        let (_, tokenizer) = reference();
        let refusal = |phrases: &[&str]| {
            let phrases: Vec<String> = phrases.iter().map(|&phrase| phrase.to_owned()).collect();
            Caption::new(&tokenizer, &phrases).unwrap_err().to_string()
        };
        assert!(refusal(&[]).contains("nothing to search for"));
        assert!(refusal(&["cat", " . "]).contains("' . '"));
        assert!(refusal(&["cat. dog"]).contains("'cat. dog'"));
        assert!(refusal(&["cat"; 200]).contains("402 tokens"));
        assert!(
            Tokenizer::new("[CLS]\n[SEP]\n[UNK]")
                .unwrap_err()
                .to_string()
                .contains("'.'")
        );
    }
}
