//! MagicaVoxel files, and the whole-number places of voxels.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;

use glam::{DVec3, IVec3};

use super::labels::{color_of, path_name};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Voxels a side that a model can have.
const SIDE: i32 = 256;
/// Colours that a palette can have.
const COLORS: usize = 255;

/// The voxels of one label in one cube of the grid.
struct Model {
    name: String,
    /// The palette's entry, from 1.
    color: u8,
    least: IVec3,
    size: IVec3,
    places: Vec<IVec3>,
}

/// Writes voxels for MagicaVoxel (version 150, with the scene graph of its extension): for each label an object named by
/// its path, in several models of at most 256 voxels a side where it is larger; the palette holds the labels' colours in
/// rising order of ids. The world's axes (x right, y down, z forward) become x, -z and y, so that up is up.
pub(super) fn save(
    path: &Path,
    voxels: &LabelledCloud,
    voxel: f64,
    progress: &Progress,
) -> Result<(), SceneError> {
    let ids: BTreeSet<LabelId> = voxels.labels.iter().copied().collect();
    if ids.len() > COLORS {
        return Err(SceneError::Request(format!(
            "a .vox file holds {COLORS} colours and there are {} labels; read them at a higher level, or write .npz or .ply",
            ids.len()
        )));
    }
    let models = models(voxels, &ids, voxel)?;
    progress.check()?;
    let mut children = Vec::new();
    for (at, model) in models.iter().enumerate() {
        progress.step(at, models.len())?;
        children.extend(chunk(b"SIZE", &numbers(&model.size.to_array()), &[]));
        children.extend(chunk(b"XYZI", &voxel_bytes(model), &[]));
    }
    children.extend(graph(&models));
    children.extend(chunk(b"RGBA", &palette(voxels, &ids), &[]));
    let bytes = [
        b"VOX ",
        &numbers(&[150])[..],
        &chunk(b"MAIN", &[], &children),
    ]
    .concat();
    write_whole(path, |out| out.write_all(&bytes).map_err(unplaced))
}

fn models(
    voxels: &LabelledCloud,
    ids: &BTreeSet<LabelId>,
    voxel: f64,
) -> Result<Vec<Model>, SceneError> {
    let places = Places::of(voxels, voxel)?.indices;
    let upright = |at: &IVec3| IVec3::new(at.x, at.z, -at.y);
    let mut cubes: BTreeMap<(LabelId, [i32; 3]), Vec<IVec3>> = BTreeMap::new();
    for (place, &id) in places.iter().map(upright).zip(&voxels.labels) {
        cubes
            .entry((id, place.div_euclid(IVec3::splat(SIDE)).to_array()))
            .or_default()
            .push(place);
    }
    let color: BTreeMap<LabelId, u8> = ids.iter().copied().zip(1..=u8::MAX).collect();
    let model = |((id, _), places): ((LabelId, [i32; 3]), Vec<IVec3>)| {
        let bound =
            |of: fn(IVec3, IVec3) -> IVec3| places.iter().copied().reduce(of).unwrap_or_default();
        let least = bound(IVec3::min);
        let size = bound(IVec3::max) - least + 1;
        Model {
            name: path_name(&voxels.tree, id),
            color: color[&id],
            least,
            size,
            places,
        }
    };
    Ok(cubes.into_iter().map(model).collect())
}

fn voxel_bytes(model: &Model) -> Vec<u8> {
    let mut bytes = numbers(&[model.places.len() as i32]);
    for place in &model.places {
        bytes.extend((*place - model.least).to_array().map(|along| along as u8));
        bytes.push(model.color);
    }
    bytes
}

/// The scene: a transform and a group at the top, below them a transform (with the label's name and the model's place)
/// and a shape for each model. What is shown stands on the ground in the middle.
fn graph(models: &[Model]) -> Vec<u8> {
    let least = models
        .iter()
        .map(|model| model.least)
        .reduce(IVec3::min)
        .unwrap_or_default();
    let most = models
        .iter()
        .map(|model| model.least + model.size)
        .reduce(IVec3::max)
        .unwrap_or_default();
    let ground = ((least + most) / 2).with_z(least.z);
    let mut bytes = transform(0, &[], 1, IVec3::ZERO);
    let nodes: Vec<i32> = (0..models.len() as i32).map(|at| 2 + 2 * at).collect();
    let group = [
        numbers(&[1]),
        dictionary(&[]),
        numbers(&[nodes.len() as i32]),
        numbers(&nodes),
    ]
    .concat();
    bytes.extend(chunk(b"nGRP", &group, &[]));
    for ((&node, model), at) in nodes.iter().zip(models).zip(0..) {
        // A model is placed by its middle.
        let place = model.least + model.size / 2 - ground;
        bytes.extend(transform(node, &[("_name", &model.name)], node + 1, place));
        let shape = [
            numbers(&[node + 1]),
            dictionary(&[]),
            numbers(&[1, at]),
            dictionary(&[]),
        ]
        .concat();
        bytes.extend(chunk(b"nSHP", &shape, &[]));
    }
    bytes
}

fn transform(node: i32, attributes: &[(&str, &str)], child: i32, place: IVec3) -> Vec<u8> {
    let place = format!("{} {} {}", place.x, place.y, place.z);
    // The reserved -1, layer 0, one frame.
    let rest = [numbers(&[child, -1, 0, 1]), dictionary(&[("_t", &place)])].concat();
    chunk(
        b"nTRN",
        &[numbers(&[node]), dictionary(attributes), rest].concat(),
        &[],
    )
}

fn palette(voxels: &LabelledCloud, ids: &BTreeSet<LabelId>) -> Vec<u8> {
    let colors = ids.iter().map(|&id| color_of(&voxels.tree, id));
    let filled = colors.chain(std::iter::repeat([0; 3])).take(COLORS + 1);
    filled
        .flat_map(|[red, green, blue]| [red, green, blue, 255])
        .collect()
}

fn chunk(id: &[u8; 4], content: &[u8], children: &[u8]) -> Vec<u8> {
    [
        id,
        &numbers(&[content.len() as i32, children.len() as i32])[..],
        content,
        children,
    ]
    .concat()
}

fn numbers(numbers: &[i32]) -> Vec<u8> {
    numbers.iter().copied().flat_map(i32::to_le_bytes).collect()
}

fn dictionary(pairs: &[(&str, &str)]) -> Vec<u8> {
    let text = |text: &str| [&numbers(&[text.len() as i32])[..], text.as_bytes()].concat();
    let mut bytes = numbers(&[pairs.len() as i32]);
    pairs
        .iter()
        .for_each(|(key, value)| bytes.extend([text(key), text(value)].concat()));
    bytes
}

/// Where voxels lie in their grid.
pub(super) struct Places {
    /// The corner of the voxel at (0, 0, 0) that is lowest along each axis, world units.
    pub(super) origin: DVec3,
    /// Each voxel's place along x, y and z, from 0.
    pub(super) indices: Vec<IVec3>,
}

impl Places {
    /// Of voxels of edge `voxel` (world units), each a point at its middle; the grid's corners are multiples of the edge.
    pub(super) fn of(voxels: &LabelledCloud, voxel: f64) -> Result<Self, SceneError> {
        if voxels.is_empty() {
            return Err(SceneError::Request("there are no voxels to write".into()));
        }
        let place = |at: &glam::Vec3| (at.as_dvec3() / voxel).floor().as_ivec3();
        let mut indices: Vec<IVec3> = voxels.positions.iter().map(place).collect();
        let least = indices
            .iter()
            .copied()
            .reduce(IVec3::min)
            .unwrap_or_default();
        indices.iter_mut().for_each(|index| *index -= least);
        Ok(Self {
            origin: least.as_dvec3() * voxel,
            indices,
        })
    }
}
