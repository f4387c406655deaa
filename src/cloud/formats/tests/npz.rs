use std::collections::BTreeMap;

use super::voxels::{VOXEL, saved, voxels};
use crate::ply::SavedColors;
use crate::{LabelledCloud, UNLABELLED_COLOR};

/// Type, shape and entries of an array.
type Array = (String, String, Vec<u8>);

fn short(bytes: &[u8], at: usize) -> usize {
    usize::from(u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()))
}

fn long(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// Reads a ZIP file by its central directory, as unpackers do.
fn unzip(bytes: &[u8]) -> BTreeMap<String, Vec<u8>> {
    let end = bytes.len() - 22;
    assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
    let (count, mut at) = (short(bytes, end + 10), long(bytes, end + 16));
    assert_eq!(at + long(bytes, end + 12), end);
    let mut files = BTreeMap::new();
    for _ in 0..count {
        assert_eq!(&bytes[at..at + 4], b"PK\x01\x02");
        let (size, name_length, start) = (
            long(bytes, at + 24),
            short(bytes, at + 28),
            long(bytes, at + 42),
        );
        let name = &bytes[at + 46..][..name_length];
        assert_eq!(&bytes[start..start + 4], b"PK\x03\x04");
        assert_eq!(
            bytes[start + 4..start + 30],
            bytes[at + 6..at + 32],
            "both heads tell the same"
        );
        assert_eq!(&bytes[start + 30..][..name_length], name);
        let content = bytes[start + 30 + name_length..][..size].to_vec();
        files.insert(String::from_utf8(name.to_vec()).unwrap(), content);
        at += 46 + name_length;
    }
    assert_eq!(at, end);
    files
}

fn array(bytes: &[u8]) -> Array {
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let start = 10 + short(bytes, 8);
    assert_eq!((start % 64, bytes[start - 1]), (0, b'\n'));
    let head = std::str::from_utf8(&bytes[10..start]).unwrap();
    let between = |from: &str, to: &str| {
        head.split_once(from)
            .unwrap()
            .1
            .split_once(to)
            .unwrap()
            .0
            .to_owned()
    };
    (
        between("'descr': '", "'"),
        between("'shape': ", ", }").replace(' ', ""),
        bytes[start..].to_vec(),
    )
}

fn written(voxels: &LabelledCloud, coloring: SavedColors) -> BTreeMap<String, Array> {
    let files = unzip(&saved(voxels, "voxels.npz", coloring).unwrap());
    files
        .into_iter()
        .map(|(name, bytes)| (name.strip_suffix(".npy").unwrap().to_owned(), array(&bytes)))
        .collect()
}

#[test]
fn voxels_survive_a_round_trip() {
    let places = [[-3, 5, 7], [0, 5, 6], [2, 9, 6], [2, 9, 1000]];
    let arrays = written(&voxels(&places), SavedColors::Image);
    let kinds: Vec<_> = arrays
        .iter()
        .map(|(name, (kind, shape, _))| [name.as_str(), kind, shape])
        .collect();
    let expected = [
        ["colors", "|u1", "(4,3,)"],
        ["confidence", "<f4", "(4,)"],
        ["indices", "<i4", "(4,3,)"],
        ["label_ids", "<u2", "(3,)"],
        ["label_names", "<U21", "(3,)"],
        ["labels", "<u2", "(4,)"],
        ["origin", "<f8", "(3,)"],
        ["voxel_size", "<f8", "()"],
    ];
    assert_eq!(kinds, expected);
    let bytes = |name: &str| arrays[name].2.as_slice();
    let doubles = |name: &str| -> Vec<f64> {
        bytes(name)
            .chunks(8)
            .map(|eight| f64::from_le_bytes(eight.try_into().unwrap()))
            .collect()
    };
    let (origin, size) = (doubles("origin"), doubles("voxel_size")[0]);
    assert_eq!(size, VOXEL);
    let indices: Vec<i32> = bytes("indices")
        .chunks(4)
        .map(|four| long(four, 0) as i32)
        .collect();
    for (index, place) in indices.chunks(3).zip(&places) {
        for along in 0..3 {
            let middle = origin[along] + (f64::from(index[along]) + 0.5) * size;
            assert!(
                (middle - (f64::from(place[along]) + 0.5) * VOXEL).abs() < 1e-9
                    && index[along] >= 0
            );
        }
    }
    let shorts = |name: &str| {
        bytes(name)
            .chunks(2)
            .map(|two| short(two, 0))
            .collect::<Vec<_>>()
    };
    assert_eq!(
        (shorts("labels"), shorts("label_ids")),
        (vec![3, 7, 0, 3], vec![0, 3, 7])
    );
    assert_eq!(bytes("confidence")[4..8], 0.5f32.to_le_bytes());
    assert_eq!(bytes("colors")[9..], [3, 100, 200]);
    let letters: Vec<char> = bytes("label_names")
        .chunks(4)
        .map(|four| char::from_u32(long(four, 0) as u32).unwrap())
        .collect();
    let names: Vec<String> = letters
        .chunks(21)
        .map(|name| {
            name.iter()
                .collect::<String>()
                .trim_end_matches('\0')
                .into()
        })
        .collect();
    assert_eq!(names, ["unlabelled", "the plant/feuille été", "the plant"]);
}

#[test]
fn label_coloring_writes_label_colours() {
    let arrays = written(
        &voxels(&[[0, 0, 0], [1, 0, 0], [2, 0, 0]]),
        SavedColors::Labels,
    );
    assert_eq!(
        arrays["colors"].2,
        [[255, 102, 0], [0, 51, 255], UNLABELLED_COLOR].as_flattened()
    );
}
