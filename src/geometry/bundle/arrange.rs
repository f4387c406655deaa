use super::layout::{Layout, Observation, PointBlock};
use super::problem::{Bundle, BundleOptions};
use super::state::CameraState;
use crate::blocks::BLOCK;

/// Least number of observations at which a piece is full.
const PIECE: usize = 512;
/// Least number of observations of a full piece per block of unknowns.
///
/// Each piece has a list of all blocks, and each block asks each piece for its entries. With pieces
/// of a fixed size, time and memory for that grow with the square of the number of images.
const PIECE_PER_BLOCK: usize = 2;

/// Observations of one point that are used.
struct Track {
    point: u32,
    observations: Vec<Observation>,
}

/// Sorts a bundle into pieces and numbers its unknowns.
///
/// Observations are ignored if they are not finite, have invalid indices or are not visible at the
/// start. Points seen from fewer than two images are ignored unless points are fixed. Anything left
/// without observations keeps its value.
pub(super) fn arrange(
    bundle: &Bundle,
    options: &BundleOptions,
    state: &CameraState,
) -> (Layout, Vec<PointBlock>) {
    let arranger = Arranger {
        bundle,
        options,
        state,
    };
    let tracks = arranger.tracks();
    let mut layout = arranger.number(&tracks);
    let full = PIECE.max(PIECE_PER_BLOCK * layout.len());
    let mut point_blocks: Vec<PointBlock> = Vec::new();
    for track in tracks {
        if point_blocks
            .last()
            .is_none_or(|point_block| point_block.observations.len() >= full)
        {
            point_blocks.push(PointBlock {
                starts: vec![0],
                ..PointBlock::default()
            });
        }
        if let Some(point_block) = point_blocks.last_mut() {
            arranger.append(point_block, &mut layout, track);
        }
    }
    for point_block in &mut point_blocks {
        point_block.tried.clone_from(&point_block.points);
        // A piece is full soon after a power of two, where a vector has twice the room.
        point_block.observations.shrink_to_fit();
        point_block.by_observation.finish(layout.len());
        point_block.by_point.finish(layout.len());
    }
    (layout, point_blocks)
}

/// A bundle, its options and its cameras at the start.
struct Arranger<'a> {
    bundle: &'a Bundle,
    options: &'a BundleOptions,
    state: &'a CameraState,
}

impl Arranger<'_> {
    /// Returns the observations that are used, by point.
    fn tracks(&self) -> Vec<Track> {
        let Self {
            bundle,
            options,
            state,
        } = *self;
        let exists = |image: u32| {
            let camera = bundle
                .images
                .get(image as usize)
                .map(|image| image.camera as usize);
            camera.is_some_and(|camera| camera < bundle.cameras.len())
        };
        let mut order: Vec<u32> = (0..bundle.observations.len() as u32).collect();
        order.retain(|&i| {
            let seen = &bundle.observations[i as usize];
            let point = bundle.points.get(seen.point as usize);
            exists(seen.image)
                && seen.at_px.is_finite()
                && point.is_some_and(|&point| state.sees(point, seen.image))
        });
        let key = |&i: &u32| {
            (
                bundle.observations[i as usize].point,
                bundle.observations[i as usize].image,
            )
        };
        order.sort_by_key(key);
        let same_point = |a: &u32, b: &u32| key(a).0 == key(b).0;
        let many = |of_point: &&[u32]| {
            options.fixed_points
                || of_point.first().map(key).map(|k| k.1) != of_point.last().map(key).map(|k| k.1)
        };
        let observation = |&i: &u32| {
            let seen = &bundle.observations[i as usize];
            Observation {
                image: seen.image,
                at_px: seen.at_px,
            }
        };
        let track = |of_point: &[u32]| Track {
            point: key(&of_point[0]).0,
            observations: of_point.iter().map(observation).collect(),
        };
        order.chunk_by(same_point).filter(many).map(track).collect()
    }

    /// Assigns a block to each pose and camera that is free and observed.
    fn number(&self, tracks: &[Track]) -> Layout {
        let Self {
            bundle,
            options,
            state,
        } = *self;
        let mut observed = vec![false; bundle.images.len()];
        for observation in tracks.iter().flat_map(|track| &track.observations) {
            observed[observation.image as usize] = true;
        }
        let mut layout = Layout {
            fixed_points: options.fixed_points,
            ..Layout::default()
        };
        let mut next = 0;
        for (image, &observed) in observed.iter().enumerate() {
            let moves = observed && !options.fixed_images.get(image).copied().unwrap_or(false);
            layout.poses.push(moves.then_some(next));
            next += usize::from(moves);
        }
        for camera in 0..bundle.cameras.len() {
            let seen = (0..bundle.images.len())
                .any(|image| observed[image] && state.camera_of(image as u32) == camera);
            let blocks = if seen {
                state.intrinsics(camera).div_ceil(BLOCK)
            } else {
                0
            };
            layout.intrinsics.push(next..next + blocks);
            next += blocks;
        }
        layout.first = (0..next).collect();
        layout
    }

    /// Appends a track to a piece, and notes the blocks that its point connects.
    fn append(&self, point_block: &mut PointBlock, layout: &mut Layout, mut track: Track) {
        let Self {
            bundle,
            options,
            state,
        } = *self;
        let intrinsics = |observation: &Observation| {
            layout.intrinsics[state.camera_of(observation.image)].clone()
        };
        track
            .observations
            .sort_by_key(|observation| layout.poses[observation.image as usize]);
        let mut shared: Vec<usize> = Vec::new();
        for observation in &track.observations {
            let pose = layout.poses[observation.image as usize];
            point_block
                .by_observation
                .push(pose.into_iter().chain(intrinsics(observation)));
            shared.extend(intrinsics(observation));
        }
        shared.sort_unstable();
        shared.dedup();
        let poses = track
            .observations
            .iter()
            .filter_map(|observation| layout.poses[observation.image as usize]);
        let blocks: Vec<usize> = poses.chain(shared).collect();
        if let Some(&lowest) = blocks.first() {
            for &block in &blocks {
                layout.first[block] = layout.first[block].min(lowest);
            }
        }
        point_block.by_point.push(if options.fixed_points {
            Vec::new()
        } else {
            blocks
        });
        point_block.ids.push(track.point);
        point_block.points.push(bundle.points[track.point as usize]);
        point_block.observations.extend(track.observations);
        point_block
            .starts
            .push(point_block.observations.len() as u32);
    }
}
