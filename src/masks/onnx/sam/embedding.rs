use super::part::ImagePart;
use crate::MaskError;

/// Output of the image encoder: everything needed to answer prompts.
///
/// Expensive to compute, cheap to store.
#[derive(Debug, Clone, PartialEq)]
pub struct Embedding {
    /// Columns of the whole image.
    pub width: u32,
    /// Rows of the whole image.
    pub height: u32,
    /// Part of the image that the network saw.
    pub part: ImagePart,
    /// Number of values per cell.
    pub channels: usize,
    /// Number of cells along each side.
    pub cells: usize,
    /// Values, `[channels, cells, cells]`, the last dimension fastest.
    pub values: Vec<f32>,
}

/// Number of integers before the values.
const HEAD: usize = 8;

impl Embedding {
    /// Serialises the embedding for a file.
    ///
    /// Eight 32-bit integers (columns, rows, the part, channels, cells) come before the values; all
    /// are little-endian.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let ImagePart {
            x,
            y,
            width,
            height,
        } = self.part;
        let head = [
            self.width,
            self.height,
            x,
            y,
            width,
            height,
            self.channels as u32,
            self.cells as u32,
        ];
        let head = head.iter().flat_map(|number| number.to_le_bytes());
        head.chain(self.values.iter().flat_map(|value| value.to_le_bytes()))
            .collect()
    }

    /// Reads an embedding from the bytes of [`Self::to_bytes`].
    ///
    /// # Errors
    /// [`MaskError::Network`] if the bytes are truncated or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MaskError> {
        let broken = || {
            MaskError::Network("a kept embedding is damaged; delete it, it is made again".into())
        };
        let words: Vec<[u8; 4]> = bytes
            .chunks_exact(4)
            .filter_map(|word| word.try_into().ok())
            .collect();
        let (head, values) = words.split_at_checked(HEAD).ok_or_else(broken)?;
        let head: Vec<u32> = head.iter().map(|&word| u32::from_le_bytes(word)).collect();
        let part = ImagePart {
            x: head[2],
            y: head[3],
            width: head[4],
            height: head[5],
        };
        let (channels, cells) = (head[6] as usize, head[7] as usize);
        let count = cells
            .checked_mul(cells)
            .and_then(|cells| cells.checked_mul(channels));
        if !bytes.len().is_multiple_of(4)
            || count != Some(values.len())
            || !part.is_within(head[0], head[1])
        {
            return Err(broken());
        }
        let values = values
            .iter()
            .map(|&word| f32::from_le_bytes(word))
            .collect();
        Ok(Self {
            width: head[0],
            height: head[1],
            part,
            channels,
            cells,
            values,
        })
    }

    /// Returns the number of bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.values.len() * size_of::<f32>()
    }
}
