use super::tokenizer::Tokenizer;
use crate::MaskError;

/// Phrases as one text for the network, each ended by a full stop; a token attends to those of its own phrase only.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caption {
    /// Ids of the tokens, with a start and an end.
    pub ids: Vec<i64>,
    /// Place of each token within its phrase, from 0.
    pub positions: Vec<i64>,
    /// Number of the phrase of each token, full stop included; `None` for start and end.
    pub phrases: Vec<Option<usize>>,
}

impl Caption {
    /// Tokens that the network takes at most.
    pub const MOST: usize = 256;

    /// The caption of some phrases.
    ///
    /// # Errors
    /// [`MaskError::Request`] for no phrase, one without a word or with a full stop or question mark in it, or too many.
    pub fn new(tokenizer: &Tokenizer, phrases: &[String]) -> Result<Self, MaskError> {
        if phrases.is_empty() {
            return Err(MaskError::Request(
                "there is no word to look for; name what is to be found".into(),
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
                    "'{phrase}' is no phrase; give a few words without full stop or question mark"
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

    /// Whether each token (row) attends to each (column), row by row; 1 where it does, else 0.
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
    fn texts_have_the_tokens_of_the_reference() {
        let (reference, tokenizer) = reference();
        for (text, ids) in &reference.texts {
            assert_eq!(tokenizer.ids(text).unwrap(), *ids, "{text:?}");
        }
        assert!(reference.texts.len() > 10);
    }

    #[test]
    fn captions_are_those_of_the_reference() {
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
    fn what_is_no_phrase_is_told() {
        let (_, tokenizer) = reference();
        let told = |phrases: &[&str]| {
            let phrases: Vec<String> = phrases.iter().map(|&phrase| phrase.to_owned()).collect();
            Caption::new(&tokenizer, &phrases).unwrap_err().to_string()
        };
        assert!(told(&[]).contains("no word"));
        assert!(told(&["cat", " . "]).contains("' . '"));
        assert!(told(&["cat. dog"]).contains("'cat. dog'"));
        assert!(told(&["cat"; 200]).contains("402 tokens"));
        assert!(
            Tokenizer::new("[CLS]\n[SEP]\n[UNK]")
                .unwrap_err()
                .to_string()
                .contains("'.'")
        );
    }
}
