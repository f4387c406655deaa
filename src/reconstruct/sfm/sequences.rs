//! Recognition of sequences: photos numbered one after the other, and frames of a video.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use ostra_frames::{Frame, ImageSource};

/// Images that were taken one after the other, in this order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Sequence {
    /// Numbers of the images.
    pub images: Vec<usize>,
    /// Number in the name of each image, or of each frame in its video; ascending.
    pub counters: Vec<u64>,
}

/// What the images of one sequence have in common.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    Video(PathBuf),
    /// A folder and the texts between the numbers of a name.
    Numbered(PathBuf, Vec<String>),
    /// A folder, for the names without a number.
    Unnumbered(PathBuf),
}

/// An image with the numbers in its name.
struct NumberedImage {
    image: usize,
    numbers: Vec<u64>,
}

/// Returns the sequences that frames belong to, each frame to one, in the order of their first frames.
///
/// Images of a folder are of one sequence if their names differ in one number only. If several
/// numbers differ, the one with most values counts, and the others tell sequences apart: `left_007`
/// and `right_007`, or `camera1_007` and `camera2_007`, are of two. The remaining images of a folder
/// are in the order given.
pub(super) fn sequences(frames: &[&Frame]) -> Vec<Sequence> {
    let mut places: BTreeMap<Place, Vec<NumberedImage>> = BTreeMap::new();
    for (image, frame) in frames.iter().enumerate() {
        let (place, numbers) = place_of(frame, image);
        let images = places.entry(place).or_default();
        images.push(NumberedImage { image, numbers });
    }
    let mut sequences = Vec::new();
    let mut rest: BTreeMap<PathBuf, Vec<usize>> = BTreeMap::new();
    for (place, images) in places {
        for sequence in split(images) {
            match &place {
                Place::Numbered(folder, _) if sequence.images.len() == 1 => {
                    let alone = rest.entry(folder.clone()).or_default();
                    alone.extend(sequence.images);
                }
                Place::Unnumbered(folder) => {
                    let others = rest.entry(folder.clone()).or_default();
                    others.extend(sequence.images);
                }
                _ => sequences.push(sequence),
            }
        }
    }
    sequences.extend(rest.into_values().map(|mut images| {
        images.sort_unstable();
        let counters = images.iter().map(|&image| image as u64).collect();
        Sequence { images, counters }
    }));
    sequences.sort_by_key(|sequence| sequence.images.first().copied());
    sequences
}

fn place_of(frame: &Frame, image: usize) -> (Place, Vec<u64>) {
    match &frame.image {
        ImageSource::Video { path, index, .. } => (Place::Video(path.clone()), vec![*index]),
        ImageSource::File { path, .. } => {
            let folder = path.parent().unwrap_or(path).to_path_buf();
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let (texts, numbers) = texts_and_numbers(&stem);
            if numbers.is_empty() {
                return (Place::Unnumbered(folder), vec![image as u64]);
            }
            (Place::Numbered(folder, texts), numbers)
        }
    }
}

/// Splits a name at its numbers. A number that is too large counts as the largest.
fn texts_and_numbers(name: &str) -> (Vec<String>, Vec<u64>) {
    let is_digit = |letter: char| letter.is_ascii_digit();
    let texts = name.split(is_digit).filter(|text| !text.is_empty());
    let numbers = name
        .split(|letter| !is_digit(letter))
        .filter(|digits| !digits.is_empty())
        .map(|digits| digits.parse().unwrap_or(u64::MAX));
    (texts.map(str::to_owned).collect(), numbers.collect())
}

/// Splits images whose names have the same texts into sequences by all numbers but one.
fn split(images: Vec<NumberedImage>) -> Vec<Sequence> {
    let count = images.first().map_or(0, |image| image.numbers.len());
    let values = |at: usize| -> BTreeSet<u64> {
        let number = |image: &NumberedImage| image.numbers.get(at).copied();
        images.iter().filter_map(number).collect()
    };
    let counter = (0..count).max_by_key(|&at| values(at).len()).unwrap_or(0);
    let mut parts: BTreeMap<Vec<u64>, Vec<(u64, usize)>> = BTreeMap::new();
    for NumberedImage { image, mut numbers } in images {
        let number = numbers.remove(counter);
        parts.entry(numbers).or_default().push((number, image));
    }
    let part = |mut members: Vec<(u64, usize)>| {
        members.sort_unstable();
        let (counters, images) = members.into_iter().unzip();
        Sequence { images, counters }
    };
    parts.into_values().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the sequences of image files, by their names.
    fn names_of_sequences(names: &[&str]) -> Vec<Vec<String>> {
        let frames: Vec<Frame> = names.iter().map(|name| frame(name)).collect();
        let sequences = sequences(&frames.iter().collect::<Vec<_>>());
        let all = sequences.into_iter().map(|sequence| {
            assert!(sequence.counters.is_sorted_by(|one, next| one < next));
            let names = sequence.images.iter().map(|&image| names[image].to_owned());
            names.collect()
        });
        all.collect()
    }

    fn frame(name: &str) -> Frame {
        Frame {
            name: name.to_owned(),
            width: 4,
            height: 4,
            image: ImageSource::File {
                path: PathBuf::from("/photos").join(name),
                orientation: ostra_frames::Orientation::default(),
            },
            depth: None,
            camera: None,
        }
    }

    #[test]
    fn numbers_order_a_sequence_whatever_the_order_of_the_names() {
        let names = ["DSC_10.jpg", "DSC_9.jpg", "DSC_0011.jpg"];
        assert_eq!(
            names_of_sequences(&names),
            [["DSC_9.jpg", "DSC_10.jpg", "DSC_0011.jpg"]]
        );
        let times = ["20260412_093000.jpg", "20260412_093107.jpg"];
        assert_eq!(names_of_sequences(&times), [times]);
    }

    #[test]
    fn folders_and_cameras_are_sequences_of_their_own() {
        let folders = [
            "left/001.png",
            "left/002.png",
            "right/001.png",
            "right/002.png",
        ];
        let expected = [
            ["left/001.png", "left/002.png"],
            ["right/001.png", "right/002.png"],
        ];
        assert_eq!(names_of_sequences(&folders), expected);
        let cameras = [
            "c1_07.png",
            "c1_08.png",
            "c1_09.png",
            "c2_07.png",
            "c2_08.png",
            "c2_09.png",
        ];
        let expected = [&cameras[..3], &cameras[3..]];
        assert_eq!(names_of_sequences(&cameras), expected);
        let tilts = [
            "a_001_t0.png",
            "a_001_t1.png",
            "a_002_t0.png",
            "a_002_t1.png",
            "a_003_t0.png",
            "a_003_t1.png",
        ];
        let expected = [
            ["a_001_t0.png", "a_002_t0.png", "a_003_t0.png"],
            ["a_001_t1.png", "a_002_t1.png", "a_003_t1.png"],
        ];
        assert_eq!(names_of_sequences(&tilts), expected);
    }

    #[test]
    fn names_without_a_common_pattern_are_in_the_order_given() {
        let names = ["a1f.jpg", "front.jpg", "side.jpg", "x9.jpg"];
        assert_eq!(names_of_sequences(&names), [names]);
    }

    #[test]
    fn frames_of_a_video_are_a_sequence() {
        let of_video = |video: &str, index: u64| Frame {
            image: ImageSource::Video {
                path: PathBuf::from(video),
                index,
                time_s: index as f64,
            },
            ..frame("unused")
        };
        let frames = [
            of_video("/a.mp4", 8),
            of_video("/a.mp4", 4),
            of_video("/b.mp4", 4),
        ];
        let found = sequences(&frames.iter().collect::<Vec<_>>());
        let images: Vec<&[usize]> = found.iter().map(|sequence| &sequence.images[..]).collect();
        assert_eq!(images, [&[1, 0][..], &[2]]);
        assert_eq!(found[0].counters, [4, 8]);
    }
}
