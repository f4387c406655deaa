//! MagicaVoxel files, and integer grid indices of voxels.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufWriter, Write};
use std::path::Path;

use dot_vox::{Color, Dict, DotVoxData, Frame, Model, SceneNode, ShapeModel, Size, Voxel};
use glam::{DVec3, IVec3};

use super::labels::{color_of, path_name};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Maximum side length of a model, in voxels.
const SIDE: i32 = 256;
/// Maximum number of colours in a palette.
const COLORS: usize = 255;

/// The voxels of one label within one cube of the grid.
struct LabelModel {
    name: String,
    /// Palette index, counted from 0.
    color: u8,
    least: IVec3,
    size: IVec3,
    places: Vec<IVec3>,
}

/// Writes voxels for MagicaVoxel (version 150, with the scene graph extension).
///
/// Each label is an object named after its path. Larger objects are split into models of at most
/// 256 voxels a side. The palette holds the label colours in ascending order of ids. The world axes
/// (x right, y down, z forward) become x, -z and y, so that up is up.
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
    let mut data = DotVoxData {
        version: 150,
        index_map: Vec::new(),
        models: Vec::with_capacity(models.len()),
        palette: palette(voxels, &ids),
        materials: Vec::new(),
        scenes: scene_graph(&models),
        layers: Vec::new(),
    };
    for (at, model) in models.iter().enumerate() {
        progress.step(at, models.len())?;
        data.models.push(vox_model(model));
    }
    write_whole(path, |out| {
        let mut out = BufWriter::new(out);
        data.write_vox(&mut out)
            .and_then(|()| out.flush())
            .map_err(unplaced)
    })
}

fn models(
    voxels: &LabelledCloud,
    ids: &BTreeSet<LabelId>,
    voxel: f64,
) -> Result<Vec<LabelModel>, SceneError> {
    let places = Places::of(voxels, voxel)?.indices;
    let upright = |at: &IVec3| IVec3::new(at.x, at.z, -at.y);
    let mut cubes: BTreeMap<(LabelId, [i32; 3]), Vec<IVec3>> = BTreeMap::new();
    for (place, &id) in places.iter().map(upright).zip(&voxels.labels) {
        cubes
            .entry((id, place.div_euclid(IVec3::splat(SIDE)).to_array()))
            .or_default()
            .push(place);
    }
    let color: BTreeMap<LabelId, u8> = ids.iter().copied().zip(0..).collect();
    let model = |((id, _), places): ((LabelId, [i32; 3]), Vec<IVec3>)| {
        let bound =
            |of: fn(IVec3, IVec3) -> IVec3| places.iter().copied().reduce(of).unwrap_or_default();
        let least = bound(IVec3::min);
        let size = bound(IVec3::max) - least + 1;
        LabelModel {
            name: path_name(&voxels.tree, id),
            color: color[&id],
            least,
            size,
            places,
        }
    };
    Ok(cubes.into_iter().map(model).collect())
}

fn vox_model(model: &LabelModel) -> Model {
    let voxel = |place: &IVec3| {
        let [x, y, z] = (place - model.least).to_array().map(|along| along as u8);
        let i = model.color;
        Voxel { x, y, z, i }
    };
    let [x, y, z] = model.size.to_array().map(|along| along as u32);
    Model {
        size: Size { x, y, z },
        voxels: model.places.iter().map(voxel).collect(),
    }
}

/// Returns the scene graph, centred and resting on the ground.
///
/// The root is a transform with a group. Below it, each model has a transform (with the label's
/// name and the model's position) and a shape.
fn scene_graph(models: &[LabelModel]) -> Vec<SceneNode> {
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
    // The id of a node is its index in the list.
    let mut nodes = vec![
        transform(Dict::default(), 1, IVec3::ZERO),
        SceneNode::Group {
            attributes: Dict::default(),
            children: (0..models.len() as u32).map(|at| 2 + 2 * at).collect(),
        },
    ];
    for (model, model_id) in models.iter().zip(0..) {
        // The position of a model is that of its centre.
        let place = model.least + model.size / 2 - ground;
        let name = Dict::from_iter([("_name".to_owned(), model.name.clone())]);
        nodes.push(transform(name, nodes.len() as u32 + 1, place));
        nodes.push(SceneNode::Shape {
            attributes: Dict::default(),
            models: vec![ShapeModel {
                model_id,
                attributes: Dict::default(),
            }],
        });
    }
    nodes
}

fn transform(attributes: Dict, child: u32, place: IVec3) -> SceneNode {
    let place = format!("{} {} {}", place.x, place.y, place.z);
    SceneNode::Transform {
        attributes,
        frames: vec![Frame::new(Dict::from_iter([("_t".to_owned(), place)]))],
        child,
        layer_id: 0,
    }
}

fn palette(voxels: &LabelledCloud, ids: &BTreeSet<LabelId>) -> Vec<Color> {
    let colors = ids.iter().map(|&id| color_of(&voxels.tree, id));
    let filled = colors.chain(std::iter::repeat([0; 3])).take(COLORS + 1);
    filled.map(|[r, g, b]| Color { r, g, b, a: 255 }).collect()
}

/// Grid indices of voxels.
pub(super) struct Places {
    /// The minimum corner of the voxel at (0, 0, 0), in world units.
    pub(super) origin: DVec3,
    /// The index of each voxel along x, y and z, from 0.
    pub(super) indices: Vec<IVec3>,
}

impl Places {
    /// Computes the grid indices of voxels with edge length `voxel` (world units).
    ///
    /// Each voxel is given as the point at its centre. Grid corners are multiples of the edge
    /// length.
    pub(super) fn of(voxels: &LabelledCloud, voxel: f64) -> Result<Self, SceneError> {
        if voxels.is_empty() {
            return Err(SceneError::Request(
                "there are no voxels to write; fuse first".into(),
            ));
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
