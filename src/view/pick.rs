use std::collections::BTreeSet;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::ViewCamera;
use super::coloring::LabelColors;
use crate::frames::Frame;
use crate::masks::LabelId;
use crate::scene::LabelledCloud;

/// The point seen at a pixel position: the nearest to the eye among those within `radius_px`, preferring the one that
/// lies closest to the position when several are about equally near. Hidden labels are looked through.
#[must_use]
pub fn pick_point(
    cloud: &LabelledCloud,
    camera: &ViewCamera,
    at_px: Vec2,
    radius_px: f32,
    hidden: &BTreeSet<LabelId>,
) -> Option<usize> {
    let colors = LabelColors::new(&cloud.tree, hidden);
    let hits: Vec<(usize, f32, f32)> = cloud
        .positions
        .par_iter()
        .enumerate()
        .filter_map(|(index, &x)| {
            let (px, depth) = camera.project(x)?;
            let off = px.distance(at_px);
            (off <= radius_px && colors.get(cloud.labels[index]).is_some()).then_some((index, depth, off))
        })
        .collect();
    let nearest = hits.iter().map(|hit| hit.1).min_by(f32::total_cmp)?;
    hits.iter()
        .filter(|hit| hit.1 <= nearest * 1.01)
        .min_by(|a, b| a.2.total_cmp(&b.2).then(a.0.cmp(&b.0)))
        .map(|hit| hit.0)
}

/// The number of the frame whose camera centre lies within `radius_px` of a pixel position, nearest first.
#[must_use]
pub fn pick_frustum(frames: &[Frame], camera: &ViewCamera, at_px: Vec2, radius_px: f32) -> Option<usize> {
    let distance = |frame: &Frame| {
        let (_, pose) = frame.posed_camera()?;
        let centre: Vec3 = pose.centre().as_vec3();
        camera.project(centre).map(|(px, _)| px.distance(at_px)).filter(|&off| off <= radius_px)
    };
    frames
        .iter()
        .enumerate()
        .filter_map(|(number, frame)| Some((number, distance(frame)?)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(number, _)| number)
}
