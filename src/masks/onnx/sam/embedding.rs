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
    /// Maps in the order of the network's outputs; Segment Anything 2 has three.
    pub maps: Vec<EmbeddingMap>,
}

/// One map of an [`Embedding`].
#[derive(Debug, Clone, PartialEq)]
pub struct EmbeddingMap {
    /// Number of values per cell.
    pub channels: usize,
    /// Number of cells along each side.
    pub cells: usize,
    /// Values, `[channels, cells, cells]`, the last dimension fastest.
    pub values: Vec<f32>,
}

/// Number of integers before those of the maps.
const HEAD: usize = 7;
/// Maximum number of maps.
const MOST_MAPS: usize = 8;

impl Embedding {
    /// Serialises the embedding for a file.
    ///
    /// 32-bit integers (columns, rows, the part, number of maps, and channels and cells of each map)
    /// come before the values; all are little-endian.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let ImagePart {
            x,
            y,
            width,
            height,
        } = self.part;
        let count = self.maps.len() as u32;
        let head = [self.width, self.height, x, y, width, height, count];
        let shapes = self
            .maps
            .iter()
            .flat_map(|map| [map.channels as u32, map.cells as u32]);
        let head = head.into_iter().chain(shapes);
        let values = self.maps.iter().flat_map(|map| &map.values);
        head.flat_map(u32::to_le_bytes)
            .chain(values.flat_map(|value| value.to_le_bytes()))
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
        let integers = |words: &[[u8; 4]]| -> Vec<u32> {
            words.iter().map(|&word| u32::from_le_bytes(word)).collect()
        };
        let (head, rest) = words.split_at_checked(HEAD).ok_or_else(broken)?;
        let head = integers(head);
        let part = ImagePart {
            x: head[2],
            y: head[3],
            width: head[4],
            height: head[5],
        };
        let count = head[6] as usize;
        if !bytes.len().is_multiple_of(4)
            || count == 0
            || count > MOST_MAPS
            || !part.is_within(head[0], head[1])
        {
            return Err(broken());
        }
        let (shapes, mut values) = rest.split_at_checked(2 * count).ok_or_else(broken)?;
        let mut maps = Vec::new();
        for shape in integers(shapes).chunks_exact(2) {
            let (channels, cells) = (shape[0] as usize, shape[1] as usize);
            let count = cells
                .checked_mul(cells)
                .and_then(|cells| cells.checked_mul(channels));
            let (own, others) = count
                .and_then(|count| values.split_at_checked(count))
                .ok_or_else(broken)?;
            values = others;
            maps.push(EmbeddingMap {
                channels,
                cells,
                values: own.iter().map(|&word| f32::from_le_bytes(word)).collect(),
            });
        }
        if !values.is_empty() {
            return Err(broken());
        }
        Ok(Self {
            width: head[0],
            height: head[1],
            part,
            maps,
        })
    }

    /// Returns the number of bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let values = self.maps.iter().map(|map| map.values.len());
        values.sum::<usize>() * size_of::<f32>()
    }
}
