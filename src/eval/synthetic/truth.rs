use glam::{DVec3, Vec2, Vec3};

use super::bitmap::encoded;
use super::light::Light;
use super::model::Model;
use super::sampling::{Spot, cover};
use super::view::View;
use super::visibility::visible_spots;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelTree;

/// Which points an exact cloud has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthOptions {
    /// About one point per square of this on labelled surfaces, 0.0002–0.1 metres.
    pub spacing_m: f64,
    /// The same for the unlabelled surroundings, 0.001–0.1 metres; `None` leaves them out.
    pub surroundings_m: Option<f64>,
    /// Only points that at least so many of the scene's views see. 0 = all, also surfaces that lie inside others (a
    /// culm under its sheath) and that no camera can know.
    pub min_views: usize,
}

impl Default for TruthOptions {
    fn default() -> Self {
        Self {
            spacing_m: 0.001,
            surroundings_m: Some(0.005),
            min_views: 2,
        }
    }
}

impl TruthOptions {
    /// Whether the spacings are in range.
    ///
    /// # Errors
    /// [`SceneError::Request`] naming the one that is not.
    pub fn check(&self) -> Result<(), SceneError> {
        if !(0.0002..=0.1).contains(&self.spacing_m) {
            return Err(SceneError::Request(format!(
                "a spacing of {} m is out of range; choose 0.0002 to 0.1",
                self.spacing_m
            )));
        }
        match self.surroundings_m {
            Some(spacing) if !(0.001..=0.1).contains(&spacing) => {
                Err(SceneError::Request(format!(
                    "a spacing of {spacing} m for the surroundings is out of range; choose 0.001 to 0.1"
                )))
            }
            _ => Ok(()),
        }
    }
}

pub(super) fn exact_cloud(
    (model, light, tree): (&Model, &Light, &LabelTree),
    (views, seed): (&[View], u64),
    options: &TruthOptions,
    progress: &Progress,
) -> Result<LabelledCloud, SceneError> {
    options.check()?;
    let spots = cover(model, seed, |part| {
        if model.looks[part].label.0 == 0 {
            options.surroundings_m
        } else {
            Some(options.spacing_m)
        }
    });
    let views = if options.min_views == 0 { &[] } else { views };
    let sightings = count_sightings(model, &spots, views, progress)?;
    let mut cloud = LabelledCloud {
        tree: tree.clone(),
        ..LabelledCloud::default()
    };
    for (spot, (count, towards)) in spots.iter().zip(sightings) {
        if count < options.min_views {
            continue;
        }
        let outward = interpolate(spot, model, |v| model.normals[v]).normalize_or(Vec3::Z);
        let normal = if towards.is_some_and(|eye| (eye - spot.x).as_vec3().dot(outward) < 0.0) {
            -outward
        } else {
            outward
        };
        let look = model.look(spot.triangle as usize);
        let uv: Vec2 = interpolate(spot, model, |v| model.uv[v]);
        cloud.positions.push(spot.x.as_vec3());
        cloud.normals.push(normal);
        cloud.colors.push(encoded(
            look.albedo(uv, &model.bitmaps) * light.on(spot.x, normal, normal, look).0,
        ));
        cloud.labels.push(look.label);
        cloud.confidence.push(1.0);
    }
    Ok(cloud)
}

fn interpolate<T>(spot: &Spot, model: &Model, value: impl Fn(usize) -> T) -> T
where
    T: std::ops::Mul<f32, Output = T> + std::iter::Sum,
{
    let corners = model.triangles[spot.triangle as usize];
    corners
        .iter()
        .zip(spot.shares)
        .map(|(&v, share)| value(v as usize) * share as f32)
        .sum()
}

/// Per spot, how many views see it and the centre of the first camera that does.
type Sightings = Vec<(usize, Option<DVec3>)>;

fn count_sightings(
    model: &Model,
    spots: &[Spot],
    views: &[View],
    progress: &Progress,
) -> Result<Sightings, SceneError> {
    let mut seen = vec![(0, None); spots.len()];
    for (k, view) in views.iter().enumerate() {
        progress.step(k, views.len())?;
        let eye = view.camera_from_world.centre();
        for spot in visible_spots(model, spots, view) {
            let (count, first) = seen[spot];
            seen[spot] = (count + 1, Some(first.unwrap_or(eye)));
        }
    }
    Ok(seen)
}
