use tokenizers::Tokenizer as WordPieces;
use tokenizers::models::wordpiece::WordPiece;
use tokenizers::normalizers::bert::BertNormalizer;
use tokenizers::pre_tokenizers::bert::BertPreTokenizer;

use crate::MaskError;

/// Splits words into the pieces that BERT (uncased) knows, by a vocabulary of one piece a line.
#[derive(Debug, Clone)]
pub struct Tokenizer {
    pieces: WordPieces,
    /// What stands at the start, at the end, and between phrases.
    pub(super) start: i64,
    pub(super) end: i64,
    pub(super) stop: i64,
}

impl Tokenizer {
    /// From the text of a `vocab.txt`: the number of a line, from 0, is the id of its piece.
    ///
    /// # Errors
    /// [`MaskError::Network`] where it lacks what every caption needs.
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

    /// Ids of the pieces of a text.
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
