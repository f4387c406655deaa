use super::layout::{Layout, Piece, Sighting};
use super::problem::{Bundle, BundleOptions};
use super::state::State;
use crate::blocks::BLOCK;

/// Number of observations at which a piece is full.
const PIECE: usize = 512;

/// Observations of one point that are used.
struct Track {
    point: u32,
    sightings: Vec<Sighting>,
}

/// Sorts a bundle into pieces and numbers its unknowns.
///
/// Observations are ignored if they are not finite, have invalid indices or are not visible at the
/// start. Points seen from fewer than two images are ignored unless points are fixed. Anything left
/// without observations keeps its value.
pub(super) fn arrange(
    bundle: &Bundle,
    options: &BundleOptions,
    state: &State,
) -> (Layout, Vec<Piece>) {
    let tracks = tracks(bundle, options, state);
    let mut layout = number(bundle, options, state, &tracks);
    let mut pieces: Vec<Piece> = Vec::new();
    for track in tracks {
        if pieces
            .last()
            .is_none_or(|piece| piece.sightings.len() >= PIECE)
        {
            pieces.push(Piece {
                starts: vec![0],
                ..Piece::default()
            });
        }
        if let Some(piece) = pieces.last_mut() {
            append(piece, bundle, options, state, &mut layout, track);
        }
    }
    for piece in &mut pieces {
        piece.tried.clone_from(&piece.points);
        piece.by_sighting.finish(layout.len());
        piece.by_point.finish(layout.len());
    }
    (layout, pieces)
}

fn tracks(bundle: &Bundle, options: &BundleOptions, state: &State) -> Vec<Track> {
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
    let sighting = |&i: &u32| {
        let seen = &bundle.observations[i as usize];
        Sighting {
            image: seen.image,
            at_px: seen.at_px,
        }
    };
    let track = |of_point: &[u32]| Track {
        point: key(&of_point[0]).0,
        sightings: of_point.iter().map(sighting).collect(),
    };
    order.chunk_by(same_point).filter(many).map(track).collect()
}

/// Assigns a block to each pose and camera that is free and observed.
fn number(bundle: &Bundle, options: &BundleOptions, state: &State, tracks: &[Track]) -> Layout {
    let mut observed = vec![false; bundle.images.len()];
    for sighting in tracks.iter().flat_map(|track| &track.sightings) {
        observed[sighting.image as usize] = true;
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

fn append(
    piece: &mut Piece,
    bundle: &Bundle,
    options: &BundleOptions,
    state: &State,
    layout: &mut Layout,
    mut track: Track,
) {
    let intrinsics =
        |sighting: &Sighting| layout.intrinsics[state.camera_of(sighting.image)].clone();
    track
        .sightings
        .sort_by_key(|sighting| layout.poses[sighting.image as usize]);
    let mut shared: Vec<usize> = Vec::new();
    for sighting in &track.sightings {
        let pose = layout.poses[sighting.image as usize];
        piece
            .by_sighting
            .push(pose.into_iter().chain(intrinsics(sighting)));
        shared.extend(intrinsics(sighting));
    }
    shared.sort_unstable();
    shared.dedup();
    let poses = track
        .sightings
        .iter()
        .filter_map(|sighting| layout.poses[sighting.image as usize]);
    let blocks: Vec<usize> = poses.chain(shared).collect();
    if let Some(&lowest) = blocks.first() {
        for &block in &blocks {
            layout.first[block] = layout.first[block].min(lowest);
        }
    }
    piece.by_point.push(if options.fixed_points {
        Vec::new()
    } else {
        blocks
    });
    piece.ids.push(track.point);
    piece.points.push(bundle.points[track.point as usize]);
    piece.sightings.extend(track.sightings);
    piece.starts.push(piece.sightings.len() as u32);
}
