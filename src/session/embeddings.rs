use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use ostra_compute::nn::models_folder;
use ostra_core::disk;
use ostra_frames::Image;
use ostra_masks::MaskError;
use ostra_masks::onnx::sam::Embedding;

/// Disk cache of image embeddings, bounded in bytes; the least recently used are removed.
///
/// A file that is missing, damaged or cannot be written only costs a run of the encoder.
#[derive(Debug)]
pub(super) struct Embeddings {
    folder: PathBuf,
    budget_bytes: u64,
}

/// Maximum size of the cache in bytes: about 500 images with ViT-B.
const BUDGET_BYTES: u64 = 2 << 30;

impl Embeddings {
    /// Returns the cache in the user's data folder; `None` if the system has none.
    ///
    /// It is not part of the project, because it only saves time.
    pub(super) fn ours() -> Option<Self> {
        let folder = models_folder().ok()?.parent()?.join("embeddings");
        Some(Self {
            folder,
            budget_bytes: BUDGET_BYTES,
        })
    }

    /// Returns the embedding of an image by the network in `encoder`.
    ///
    /// It is read from disk, or computed by `embed` and saved.
    ///
    /// # Errors
    ///
    /// Returns the errors of `embed`.
    pub(super) fn get(
        &self,
        encoder: &Path,
        image: &Image,
        embed: impl FnOnce() -> Result<Embedding, MaskError>,
    ) -> Result<Embedding, MaskError> {
        let path = self.folder.join(key(encoder, image));
        if let Some(known) = fs::read(&path)
            .ok()
            .and_then(|bytes| Embedding::from_bytes(&bytes).ok())
        {
            disk::mark_used(&path);
            return Ok(known);
        }
        let made = embed()?;
        // If the file cannot be written, the next run embeds the image again.
        let _ = self.put(&path, &made.to_bytes());
        Ok(made)
    }

    fn put(&self, path: &Path, bytes: &[u8]) -> std::io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        disk::remove_leftovers(&self.folder, false);
        disk::write(path, bytes)?;
        let files = disk::kept_files(&self.folder, |name| !disk::is_temporary(name));
        disk::remove_beyond(files, self.budget_bytes);
        Ok(())
    }
}

/// Returns a key that identifies an image and a network.
///
/// The network is identified by its file's path, size and time.
fn key(encoder: &Path, image: &Image) -> String {
    let about = fs::metadata(encoder).ok();
    let of_network = (
        encoder,
        about.as_ref().map(fs::Metadata::len),
        about.and_then(|about| about.modified().ok()),
    );
    let mut digest = Sha256::new();
    digest.update(format!("{of_network:?} {}×{} ", image.width, image.height));
    digest.update(image.pixels.as_flattened());
    digest
        .finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::time::SystemTime;

    use super::*;
    use ostra_masks::onnx::sam::{EmbeddingMap, ImagePart};

    fn embedding(value: f32) -> Embedding {
        Embedding {
            width: 4,
            height: 4,
            part: ImagePart::whole(4, 4),
            maps: vec![EmbeddingMap {
                channels: 1,
                cells: 2,
                values: vec![value; 4],
            }],
        }
    }

    fn image(shade: u8) -> Image {
        Image {
            width: 4,
            height: 4,
            pixels: vec![[shade; 3]; 16],
        }
    }

    fn unwanted() -> Result<Embedding, MaskError> {
        panic!("it is known")
    }

    #[test]
    fn image_is_embedded_once_per_network() {
        let scratch = tempfile::tempdir().unwrap();
        let (first, second) = (scratch.path().join("a.onnx"), scratch.path().join("b.onnx"));
        fs::write(&first, "a").unwrap();
        let kept = Embeddings {
            folder: scratch.path().join("kept"),
            budget_bytes: 1 << 20,
        };
        assert_eq!(
            kept.get(&first, &image(1), || Ok(embedding(0.5))).unwrap(),
            embedding(0.5)
        );
        assert_eq!(
            kept.get(&first, &image(1), unwanted).unwrap(),
            embedding(0.5)
        );
        assert_eq!(
            kept.get(&second, &image(1), || Ok(embedding(2.0))).unwrap(),
            embedding(2.0),
            "another network"
        );
        assert_eq!(
            kept.get(&first, &image(2), || Ok(embedding(3.0))).unwrap(),
            embedding(3.0),
            "another image"
        );
        fs::write(&first, "changed").unwrap();
        assert_eq!(
            kept.get(&first, &image(1), || Ok(embedding(4.0))).unwrap(),
            embedding(4.0),
            "another file"
        );
        let failed = kept.get(&first, &image(9), || Err(MaskError::Request("no".into())));
        assert!(
            failed.is_err() && kept.get(&first, &image(9), || Ok(embedding(9.0))).is_ok(),
            "no failure is kept"
        );
    }

    #[test]
    fn damaged_file_is_made_again_and_old_files_are_removed() {
        let scratch = tempfile::tempdir().unwrap();
        let kept = Embeddings {
            folder: scratch.path().to_owned(),
            budget_bytes: 110,
        };
        let network = Path::new("none.onnx");
        kept.get(network, &image(1), || Ok(embedding(1.0))).unwrap();
        let path = scratch.path().join(key(network, &image(1)));
        fs::write(&path, "torn").unwrap();
        assert_eq!(
            kept.get(network, &image(1), || Ok(embedding(1.5))).unwrap(),
            embedding(1.5)
        );
        let old = SystemTime::now() - std::time::Duration::from_secs(100);
        File::options()
            .write(true)
            .open(&path)
            .unwrap()
            .set_modified(old)
            .unwrap();
        kept.get(network, &image(2), || Ok(embedding(2.0))).unwrap();
        assert_eq!(
            kept.get(network, &image(1), unwanted).unwrap(),
            embedding(1.5),
            "two of 52 bytes fit, and it is used now"
        );
        let second = scratch.path().join(key(network, &image(2)));
        File::options()
            .write(true)
            .open(&second)
            .unwrap()
            .set_modified(old)
            .unwrap();
        kept.get(network, &image(3), || Ok(embedding(3.0))).unwrap();
        assert!(
            path.exists() && !second.exists(),
            "what was not used for longest goes"
        );
    }
}
