//! Images in folders, in natural order, and the items created from them.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::error::first_of;
use crate::header::FORMATS;
use crate::{FrameError, ImageSource};
use ostra_core::disk;

/// File extensions of images, in lower case.
pub const IMAGE_ENDINGS: [&str; 8] = ["jpg", "jpeg", "png", "tif", "tiff", "webp", "jfif", "jpe"];

/// File extensions of unsupported images, in lower case.
///
/// They are those of phones, other formats, and raw files of cameras.
const UNSUPPORTED_ENDINGS: [&str; 45] = [
    "heic", "heif", "hif", "avif", "jxl", "jp2", "j2k", "jpx", "jpf", "bmp", "dib", "gif", "ppm",
    "pgm", "pbm", "pnm", "pfm", "tga", "exr", "hdr", "psd", "dng", "cr2", "cr3", "crw", "nef",
    "nrw", "arw", "srf", "sr2", "orf", "rw2", "raf", "pef", "srw", "x3f", "3fr", "iiq", "rwl",
    "raw", "mpo", "jps", "svg", "qoi", "btf",
];

/// A file below a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Listed {
    /// Path below the folder, separated by `/`.
    pub name: String,
    /// Full path.
    pub path: PathBuf,
}

/// The images in a folder and its subfolders, and the skipped files.
#[derive(Debug, Default)]
pub(super) struct FolderContent {
    /// Images in natural order.
    pub images: Vec<Listed>,
    /// Unsupported images, by their paths below the folder.
    unsupported: Vec<String>,
    /// Folders of systems and of thumbnails.
    system: Vec<String>,
    /// Images and folders with names that are not valid UTF-8, in displayable form.
    not_utf8: Vec<String>,
}

impl FolderContent {
    /// Returns warnings about the skipped files.
    pub fn warnings(&self, folder: &Path) -> Vec<String> {
        let unsupported = self
            .unsupported()
            .map(|what| format!("{}: {what}", folder.display()));
        let system = (!self.system.is_empty()).then(|| {
            let (count, names) = (self.system.len(), first_of(self.system.iter(), ", "));
            format!(
                "{}: {count} folders or thumbnails of the system are left out: {names}",
                folder.display()
            )
        });
        let not_utf8 = self
            .not_utf8()
            .map(|what| format!("{}: {what}", folder.display()));
        [unsupported, system, not_utf8]
            .into_iter()
            .flatten()
            .collect()
    }

    /// Describes skipped files that could be opened after a change; empty if there are none.
    pub fn left_out(&self) -> String {
        [self.unsupported(), self.not_utf8()]
            .into_iter()
            .flatten()
            .map(|what| format!("; {what}"))
            .collect()
    }

    fn not_utf8(&self) -> Option<String> {
        if self.not_utf8.is_empty() {
            return None;
        }
        let (count, names) = (self.not_utf8.len(), first_of(self.not_utf8.iter(), ", "));
        Some(format!(
            "{count} images or folders are left out, because their names are not valid UTF-8: {names}; rename them"
        ))
    }

    /// Describes the unsupported images; `None` if there are none.
    fn unsupported(&self) -> Option<String> {
        if self.unsupported.is_empty() {
            return None;
        }
        let (count, names) = (
            self.unsupported.len(),
            first_of(self.unsupported.iter(), ", "),
        );
        let how = how_to_convert(self.unsupported.iter().map(String::as_str));
        Some(format!(
            "{count} images are left out, because only {FORMATS} can be read: {names}; {how}"
        ))
    }
}

fn how_to_convert<'a>(mut names: impl Iterator<Item = &'a str>) -> &'static str {
    if names.any(|name| ending_is(Path::new(name), &["heic", "heif", "hif", "avif"])) {
        "convert HEIC with 'heif-convert IMAGE.heic IMAGE.jpg', or set the phone to save JPEG"
    } else {
        "convert them, e.g. with ImageMagick: 'magick mogrify -format png FILES'"
    }
}

/// Returns the error for a file with the extension of unsupported images.
///
/// `None` for other extensions, and for GIF, which ffmpeg reads as a video.
pub(super) fn unsupported_image(path: &Path) -> Option<FrameError> {
    let is_unsupported = ending_is(path, &UNSUPPORTED_ENDINGS) && !ending_is(path, &["gif"]);
    is_unsupported.then(|| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let how = how_to_convert([&*name].into_iter());
        FrameError::Invalid {
            path: path.into(),
            what: format!("only {FORMATS} images can be read; {how}"),
        }
    })
}

/// Lists the images in a folder and its subfolders.
///
/// Hidden files and folders, and those of systems, are skipped.
pub(super) fn list_images(folder: &Path) -> Result<FolderContent, FrameError> {
    let mut walk = Walk {
        found: FolderContent::default(),
        entered: BTreeSet::new(),
    };
    walk.enter(folder, "")?;
    let FolderContent {
        images,
        unsupported,
        system,
        not_utf8,
    } = &mut walk.found;
    images.sort_by(|a, b| natural_order(&a.name, &b.name));
    for names in [unsupported, system, not_utf8] {
        names.sort_by(|a, b| natural_order(a, b));
    }
    Ok(walk.found)
}

/// Returns whether a file has the extension of an image.
pub(super) fn has_image_ending(path: &Path) -> bool {
    ending_is(path, &IMAGE_ENDINGS)
}

fn ending_is(path: &Path, endings: &[&str]) -> bool {
    let ending = path
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase());
    ending.is_some_and(|ending| endings.contains(&ending.as_str()))
}

/// Returns the path as text, because projects are text files.
pub(super) fn text_of(path: &Path) -> Result<&str, FrameError> {
    path.to_str().ok_or_else(|| FrameError::Invalid {
        path: path.into(),
        what: "the name has characters that are not valid UTF-8; rename it".into(),
    })
}

struct Walk {
    found: FolderContent,
    entered: BTreeSet<PathBuf>,
}

impl Walk {
    fn enter(&mut self, folder: &Path, name: &str) -> Result<(), FrameError> {
        let io = |source| FrameError::io(folder, source);
        if !self.entered.insert(folder.canonicalize().map_err(io)?) {
            return Ok(()); // a link back to a folder that was read
        }
        for entry in std::fs::read_dir(folder).map_err(io)? {
            self.take(&entry.map_err(io)?, name)?;
        }
        Ok(())
    }

    fn take(&mut self, entry: &std::fs::DirEntry, folder_name: &str) -> Result<(), FrameError> {
        let (path, own_name) = (entry.path(), entry.file_name());
        if own_name.to_string_lossy().starts_with('.') {
            return Ok(());
        }
        let kind = entry
            .file_type()
            .map_err(|source| FrameError::io(&path, source))?;
        let is_folder = kind.is_dir() || (kind.is_symlink() && path.is_dir());
        let is_file = kind.is_file() || kind.is_symlink();
        let (is_image, is_unsupported) = (
            is_file && has_image_ending(&path),
            is_file && ending_is(&path, &UNSUPPORTED_ENDINGS),
        );
        if !is_folder && !is_image && !is_unsupported {
            return Ok(());
        }
        let own_name = own_name.to_string_lossy();
        let is_of_system = disk::is_system_file(&own_name);
        let name = if folder_name.is_empty() {
            own_name.into_owned()
        } else {
            format!("{folder_name}/{own_name}")
        };
        if is_of_system {
            self.found.system.push(name);
            return Ok(());
        }
        if is_unsupported && !is_folder {
            self.found.unsupported.push(name);
            return Ok(());
        }
        if path.to_str().is_none() {
            self.found.not_utf8.push(name);
            return Ok(());
        }
        if is_folder {
            return self.enter(&path, &name);
        }
        self.found.images.push(Listed { name, path });
        Ok(())
    }
}

/// Compares names in natural order: runs of digits compare as numbers (`2` before `10`).
///
/// The rest compares by character, folder by folder along `/`. Names that only differ in leading
/// zeros follow in byte order, so that only equal names compare equal.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let parts = a
        .split('/')
        .zip(b.split('/'))
        .map(|(a, b)| compare_parts(a, b));
    let depth = || a.split('/').count().cmp(&b.split('/').count());
    parts
        .fold(Ordering::Equal, Ordering::then)
        .then_with(depth)
        .then_with(|| a.cmp(b))
}

fn compare_parts(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    while let (Some(first_a), Some(first_b)) = (a.chars().next(), b.chars().next()) {
        let order = if first_a.is_ascii_digit() && first_b.is_ascii_digit() {
            compare_numbers(take_digits(&mut a), take_digits(&mut b))
        } else {
            (a, b) = (&a[first_a.len_utf8()..], &b[first_b.len_utf8()..]);
            first_a.cmp(&first_b)
        };
        if order.is_ne() {
            return order;
        }
    }
    a.len().cmp(&b.len())
}

fn take_digits<'a>(text: &mut &'a str) -> &'a str {
    let end = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    digits
}

/// Compares numbers of any length without parsing them.
fn compare_numbers(a: &str, b: &str) -> Ordering {
    let (a, b) = (a.trim_start_matches('0'), b.trim_start_matches('0'));
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

/// Source of an image, before its header is read.
#[derive(Debug, Clone)]
pub(super) enum Origin {
    /// An image file.
    File(PathBuf),
    /// An image of a video, with its size as shown.
    Video(ImageSource, (u32, u32)),
}

/// Returns an item without depth.
pub(super) fn without_depth(image: Listed) -> Item {
    Item {
        name: image.name,
        origin: Origin::File(image.path),
        depth: None,
    }
}

/// One image before its header is read.
#[derive(Debug)]
pub(super) struct Item {
    /// Name below the source; empty if the source is this one image.
    pub name: String,
    /// Source of the image.
    pub origin: Origin,
    /// Depth file of the image.
    pub depth: Option<PathBuf>,
}

impl Item {
    /// Returns the name and file for pairing.
    pub fn listed(&self) -> Listed {
        let path = match &self.origin {
            Origin::File(path) => path.clone(),
            Origin::Video(source, _) => source.path().into(),
        };
        Listed {
            name: self.name.clone(),
            path,
        }
    }

    /// Returns the identity of this image: its file and its index in the video.
    pub fn identity(&self) -> (PathBuf, u64) {
        match &self.origin {
            Origin::File(path) => (path.clone(), 0),
            Origin::Video(source, _) => source.identity(),
        }
    }

    /// Returns the image file and the depth file if both exist.
    pub fn files_with_depth(&self) -> Option<(&Path, &Path)> {
        match (&self.origin, &self.depth) {
            (Origin::File(image), Some(depth)) => Some((image, depth)),
            _ => None,
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;

    use super::*;

    #[test]
    fn names_that_are_not_utf8_are_skipped_with_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.png"), "").unwrap();
        std::fs::write(folder.path().join(OsStr::from_bytes(b"b\xe9.png")), "").unwrap();
        std::fs::create_dir(folder.path().join(OsStr::from_bytes(b"c\xe9"))).unwrap();
        let found = list_images(folder.path()).unwrap();
        assert_eq!(
            found
                .images
                .iter()
                .map(|listed| listed.name.as_str())
                .collect::<Vec<_>>(),
            ["a.png"]
        );
        let warnings = found.warnings(folder.path());
        assert!(
            warnings.len() == 1 && warnings[0].contains("2 images or folders are left out"),
            "{warnings:?}"
        );
    }
}

#[cfg(test)]
mod natural_tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn numbers_sort_by_value_and_folders_stay_together() {
        let mut names = [
            "10.png",
            "9.png",
            "a/2.png",
            "a-b/1.png",
            "a/10.png",
            "img_2b.png",
            "img_02a.png",
            "B.png",
        ];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(
            names,
            [
                "9.png",
                "10.png",
                "B.png",
                "a/2.png",
                "a/10.png",
                "a-b/1.png",
                "img_02a.png",
                "img_2b.png"
            ]
        );
    }

    #[test]
    fn numbers_longer_than_any_integer_are_compared() {
        let (a, b) = (
            format!("1{}.png", "0".repeat(40)),
            format!("2{}.png", "0".repeat(39)),
        );
        assert_eq!(natural_order(&b, &a), Ordering::Less);
        assert_eq!(natural_order("007", "7"), Ordering::Less);
        assert_eq!(natural_order("7", "7"), Ordering::Equal);
    }

    proptest! {
        #[test]
        fn natural_order_is_a_total_order(a in "[a0-1/é]{0,6}", b in "[a0-1/é]{0,6}", c in "[a0-1/é]{0,6}") {
            prop_assert_eq!(natural_order(&a, &b), natural_order(&b, &a).reverse());
            prop_assert_eq!(natural_order(&a, &b).is_eq(), a == b);
            if natural_order(&a, &b).is_le() && natural_order(&b, &c).is_le() {
                prop_assert!(natural_order(&a, &c).is_le());
            }
        }
    }
}
