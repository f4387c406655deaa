use std::collections::{BTreeMap, BTreeSet};

use glam::IVec3;

use super::voxels::{saved, voxels};
use crate::UNLABELLED_COLOR;
use crate::ply::SavedColors;
use ostra_masks::LabelId;

/// Reads numbers, strings and dictionaries in sequence.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, length: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at(length);
        self.0 = rest;
        taken
    }

    fn number(&mut self) -> i32 {
        i32::from_le_bytes(self.take(4).try_into().unwrap())
    }

    fn text(&mut self) -> String {
        let length = self.number() as usize;
        String::from_utf8(self.take(length).to_vec()).unwrap()
    }

    fn dictionary(&mut self) -> BTreeMap<String, String> {
        (0..self.number())
            .map(|_| (self.text(), self.text()))
            .collect()
    }
}

/// Position and colour of a voxel.
type Voxel = ([i32; 3], [u8; 3]);

/// A scene as MagicaVoxel shows it: the coloured voxels of each named object.
#[derive(Default)]
struct Scene {
    sizes: Vec<IVec3>,
    objects: BTreeMap<String, BTreeSet<Voxel>>,
}

fn read(bytes: &[u8]) -> Scene {
    let mut whole = Reader(bytes);
    assert_eq!(
        (whole.take(4), whole.number(), whole.take(4), whole.number()),
        (&b"VOX "[..], 150, &b"MAIN"[..], 0)
    );
    assert_eq!(whole.number() as usize, whole.0.len());
    let mut scene = Scene::default();
    let (mut models, mut moved, mut shapes) = (Vec::new(), BTreeMap::new(), BTreeMap::new());
    let mut palette: &[u8] = &[];
    while !whole.0.is_empty() {
        let (id, length, children) = (whole.take(4), whole.number() as usize, whole.number());
        assert_eq!(children, 0);
        let mut chunk = Reader(whole.take(length));
        match id {
            b"SIZE" => scene
                .sizes
                .push(IVec3::new(chunk.number(), chunk.number(), chunk.number())),
            b"XYZI" => {
                let count = chunk.number() as usize;
                models.push(chunk.take(4 * count));
            }
            b"nTRN" => {
                let (node, name, child) = (chunk.number(), chunk.dictionary(), chunk.number());
                assert_eq!([chunk.number(), chunk.number(), chunk.number()], [-1, 0, 1]);
                let place: Vec<i32> = chunk.dictionary()["_t"]
                    .split(' ')
                    .map(|along| along.parse().unwrap())
                    .collect();
                moved.insert(
                    child,
                    (node, name.get("_name").cloned(), IVec3::from_slice(&place)),
                );
            }
            b"nGRP" => {
                let (node, _) = (chunk.number(), chunk.dictionary());
                let nodes: Vec<i32> = (0..chunk.number()).map(|_| chunk.number()).collect();
                assert_eq!(
                    (node, moved[&1].0),
                    (1, 0),
                    "the top transform holds the group"
                );
                assert!(
                    nodes
                        .iter()
                        .enumerate()
                        .all(|(at, &node)| node == 2 + 2 * at as i32)
                );
            }
            b"nSHP" => {
                let (node, _) = (chunk.number(), chunk.dictionary());
                assert_eq!(chunk.number(), 1);
                shapes.insert(node, chunk.number() as usize);
                chunk.dictionary();
            }
            b"RGBA" => palette = chunk.take(1024),
            other => panic!("{other:?}"),
        }
        assert!(chunk.0.is_empty(), "{id:?}");
    }
    assert_eq!(
        (models.len(), shapes.len()),
        (scene.sizes.len(), scene.sizes.len())
    );
    for (node, model) in shapes {
        let (_, name, place) = &moved[&node];
        let size = scene.sizes[model];
        for voxel in models[model].chunks(4) {
            let at = IVec3::new(voxel[0].into(), voxel[1].into(), voxel[2].into());
            assert!(at.cmplt(size).all());
            let entry = 4 * (usize::from(voxel[3]) - 1);
            let color = palette[entry..entry + 3].try_into().unwrap();
            let new = scene
                .objects
                .entry(name.clone().unwrap())
                .or_default()
                .insert(((at - size / 2 + place).to_array(), color));
            assert!(new, "each voxel once");
        }
    }
    scene
}

#[test]
fn each_label_is_an_upright_object_in_its_colour() {
    let places = [[0, 0, 0], [1, 0, 0], [0, -4, 0], [0, 0, 7]];
    let scene = read(&saved(&voxels(&places), "v.vox", SavedColors::Image).unwrap());
    // x, z, -y of the world, relative to the centre of the ground.
    let expected = [
        ("the plant", [0, 51, 255], vec![[0, -4, 0]]),
        (
            "the plant/feuille été",
            [255, 102, 0],
            vec![[-1, -4, 0], [-1, 3, 0]],
        ),
        ("unlabelled", UNLABELLED_COLOR, vec![[-1, -4, 4]]),
    ];
    assert_eq!(scene.objects.len(), 3);
    for (name, color, places) in expected {
        let object = places
            .into_iter()
            .map(|place| (place, color))
            .collect::<BTreeSet<_>>();
        assert_eq!(scene.objects[name], object, "{name}");
    }
}

#[test]
fn large_objects_are_split_into_models() {
    let places: Vec<[i32; 3]> = (-350..350).map(|at| [at, at / 3, -at]).collect();
    let mut one = voxels(&places);
    one.labels.fill(LabelId(7));
    let scene = read(&saved(&one, "v.vox", SavedColors::Image).unwrap());
    assert!(scene.sizes.len() > 2 && scene.sizes.iter().all(|size| size.max_element() <= 256));
    let found: BTreeSet<[i32; 3]> = scene.objects["the plant"]
        .iter()
        .map(|(place, _)| *place)
        .collect();
    let expected: BTreeSet<[i32; 3]> = places.iter().map(|&[x, y, z]| [x, z, -y]).collect();
    assert_eq!(found.len(), 700);
    let shifts: BTreeSet<[i32; 3]> = found
        .iter()
        .zip(&expected)
        .map(|(a, b)| (IVec3::from(*a) - IVec3::from(*b)).to_array())
        .collect();
    assert_eq!(shifts.len(), 1, "all are shifted alike: {shifts:?}");
}

#[test]
fn too_many_labels_are_an_error_with_a_hint() {
    let places: Vec<[i32; 3]> = (0..256).map(|at| [at, 0, 0]).collect();
    let mut many = voxels(&places);
    many.labels = (0..256).map(LabelId).collect();
    let error = saved(&many, "v.vox", SavedColors::Image)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("256 labels") && error.contains(".npz"),
        "{error}"
    );
    many.labels[255] = LabelId(1);
    assert!(saved(&many, "v.vox", SavedColors::Image).is_ok());
}
