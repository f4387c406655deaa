//! Colours of points and vertices: by label, votes, normal or height.

use std::sync::Arc;

use glam::Vec3;

use super::spread_order::SpreadOrder;
use super::style::{Coloring, ramp};
use super::{Appearance, Bounds};
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::Votes;
use ostra_masks::{LabelId, LabelTree};

/// Number of points from which the ends of a colour ramp are estimated.
const SAMPLED: usize = 100_000;

/// An [`Appearance`] prepared for loops over the millions of points of one cloud.
///
/// Values behind colours (conflict, views, height) are computed from the votes and positions while
/// points are packed for the GPU. Storing them would cost memory for every point.
#[derive(Debug, Clone)]
pub(super) struct Paint {
    labels: LabelColors,
    source: ColorSource,
    uncertain_below: Option<f32>,
    /// Votes of the cloud and the least number of them, if points with fewer are not drawn.
    least_views: Option<(Arc<Votes>, u32)>,
    /// Opacity of faint points.
    faint: u8,
}

/// Source of the colours.
#[derive(Debug, Clone)]
enum ColorSource {
    Rgb,
    Label,
    Normals,
    Ramp { number: Number, range: [f32; 2] },
    Unknown,
}

/// A scalar per point.
#[derive(Debug, Clone)]
enum Number {
    Confidence,
    Conflict(Arc<Votes>),
    Views(Arc<Votes>),
    Height(Vec3),
}

impl Paint {
    pub(super) fn new(cloud: &LabelledCloud, appearance: &Appearance) -> Self {
        let tree = appearance.tree.as_ref().unwrap_or(&cloud.tree);
        Self {
            labels: LabelColors::new(tree, appearance),
            source: ColorSource::new(cloud, appearance),
            uncertain_below: appearance.uncertain_below,
            least_views: votes_of(cloud, appearance)
                .filter(|_| appearance.least_views > 0)
                .map(|votes| (votes, appearance.least_views)),
            faint: faint_opacity(appearance),
        }
    }

    /// Returns the sRGB colour and opacity of point `index`; `None` if it is not drawn.
    pub(super) fn color(&self, cloud: &LabelledCloud, index: usize) -> Option<[u8; 4]> {
        let label = self.labels.get(cloud.labels[index]);
        let [r, g, b] = match &self.source {
            ColorSource::Rgb => cloud.colors[index],
            ColorSource::Label => [label[0], label[1], label[2]],
            ColorSource::Normals => of_normal(cloud.normals[index]),
            ColorSource::Ramp { number, range } => {
                ramp((number.of(cloud, index) - range[0]) / (range[1] - range[0]))
            }
            ColorSource::Unknown => UNKNOWN,
        };
        let opacity = self.opacity(cloud, index);
        (opacity > 0).then_some([r, g, b, opacity])
    }

    /// Returns the opacity of point `index`, 0 (not drawn) to 255.
    pub(super) fn opacity(&self, cloud: &LabelledCloud, index: usize) -> u8 {
        if let Some((votes, least)) = &self.least_views
            && votes.voted(index) < *least
        {
            return 0;
        }
        let of_label = self.labels.get(cloud.labels[index])[3];
        let stands_out = self
            .uncertain_below
            .is_none_or(|below| cloud.is_uncertain(index, below));
        if stands_out {
            of_label
        } else {
            of_label.min(self.faint)
        }
    }

    /// Returns the values at the ends of the colour ramp, if the colours use one.
    pub(super) fn range(&self) -> Option<[f32; 2]> {
        match self.source {
            ColorSource::Ramp { range, .. } => Some(range),
            _ => None,
        }
    }
}

/// Returns the votes of a cloud, if they are known.
fn votes_of(cloud: &LabelledCloud, appearance: &Appearance) -> Option<Arc<Votes>> {
    appearance
        .votes
        .clone()
        .filter(|votes| votes.len() == cloud.len())
}

impl ColorSource {
    fn new(cloud: &LabelledCloud, appearance: &Appearance) -> Self {
        let votes = || votes_of(cloud, appearance);
        let number = match appearance.coloring {
            Coloring::Rgb => return Self::Rgb,
            Coloring::Label => return Self::Label,
            Coloring::Normals => return Self::Normals,
            Coloring::Confidence => Some(Number::Confidence),
            Coloring::Conflict => votes().map(Number::Conflict),
            Coloring::Views => votes().map(Number::Views),
            Coloring::Height => Some(Number::Height(appearance.up)),
        };
        number.map_or(Self::Unknown, |number| Self::Ramp {
            range: number.range(cloud),
            number,
        })
    }
}

impl Number {
    fn of(&self, cloud: &LabelledCloud, index: usize) -> f32 {
        match self {
            Self::Confidence => cloud.confidence[index],
            Self::Conflict(votes) => votes.conflict(index),
            Self::Views(votes) => votes.voted(index) as f32,
            Self::Height(up) => cloud.positions[index].dot(*up),
        }
    }

    /// Returns the values at the ends of the colour ramp.
    fn range(&self, cloud: &LabelledCloud) -> [f32; 2] {
        let order = SpreadOrder::new(cloud.len());
        let sample = || (0..cloud.len().min(SAMPLED)).map(|place| self.of(cloud, order.at(place)));
        match self {
            Self::Confidence => [0.0, 1.0],
            Self::Conflict(_) => [0.0, 0.5],
            Self::Views(_) => [0.0, sample().fold(1.0, f32::max)],
            Self::Height(_) => Bounds::of(sample().map(Vec3::splat)).map_or([0.0, 1.0], |bounds| {
                [
                    bounds.min.x,
                    bounds.max.x.max(bounds.min.x + f32::MIN_POSITIVE),
                ]
            }),
        }
    }
}

fn of_normal(normal: Vec3) -> [u8; 3] {
    if normal == Vec3::ZERO {
        return UNKNOWN;
    }
    normal
        .to_array()
        .map(|along| ((along * 0.5 + 0.5) * 255.0).round() as u8)
}

/// Colour (sRGB) of points without a label or a known value.
pub(super) const UNKNOWN: [u8; 3] = [120, 120, 120];

/// Colour and opacity by label, ready for loops over millions of points or pixels.
#[derive(Debug, Clone)]
pub(super) struct LabelColors {
    /// Opacity 0 means hidden; ids beyond the end belong to no label.
    by_id: Vec<[u8; 4]>,
    unlabelled: [u8; 4],
}

impl LabelColors {
    pub(super) fn new(tree: &LabelTree, appearance: &Appearance) -> Self {
        let faint = faint_opacity(appearance);
        let of_label = |id| {
            let [r, g, b] = color_at(tree, id, appearance.level);
            [r, g, b, opacity(tree, id, appearance, faint)]
        };
        let [r, g, b] = UNKNOWN;
        let by_id = (0..tree.next_id().0)
            .map(|id| of_label(LabelId(id)))
            .collect();
        Self {
            by_id,
            unlabelled: [
                r,
                g,
                b,
                if appearance.isolated.is_some() {
                    faint
                } else {
                    255
                },
            ],
        }
    }

    /// Returns the sRGB colour and opacity (0 = hidden) of a label; grey without a label.
    pub(super) fn get(&self, id: LabelId) -> [u8; 4] {
        let known = self
            .by_id
            .get(usize::from(id.0))
            .filter(|_| id != LabelId::NONE);
        known.copied().unwrap_or(self.unlabelled)
    }
}

/// Returns the opacity of faint points, 0 to 255.
fn faint_opacity(appearance: &Appearance) -> u8 {
    (appearance.faint.clamp(0.0, 1.0) * 255.0).round() as u8
}

fn color_at(tree: &LabelTree, id: LabelId, level: Option<usize>) -> [u8; 3] {
    let shown = level.map_or(id, |level| tree.at_level(id, level));
    tree.get(shown).map_or(UNKNOWN, |label| label.color)
}

fn opacity(tree: &LabelTree, id: LabelId, appearance: &Appearance, faint: u8) -> u8 {
    let path = tree.path(id);
    let is_within = |other: &LabelId| id == *other || path.contains(other);
    if appearance.hidden.iter().any(is_within) {
        0
    } else if appearance
        .isolated
        .is_none_or(|isolated| is_within(&isolated))
    {
        255
    } else {
        faint
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use ostra_masks::{Label, LabelId};

    /// Four points in a row along x: plant, leaf, pot and unlabelled.
    fn cloud() -> LabelledCloud {
        let mut cloud = LabelledCloud::from_positions((0..4).map(|i| Vec3::X * i as f32).collect());
        for (id, parent) in [(1, None), (2, Some(LabelId(1))), (3, None)] {
            let label = Label {
                id: LabelId(id),
                name: id.to_string(),
                color: [id as u8 * 50, 7, 9],
                parent,
            };
            cloud.tree.set(label).unwrap();
        }
        cloud.labels = [1, 2, 3, 0].map(LabelId).to_vec();
        cloud.confidence = vec![0.0, 0.5, 1.0, 0.0];
        cloud.normals = vec![Vec3::X, Vec3::NEG_Y, Vec3::ZERO, Vec3::Z];
        cloud
    }

    fn colors(appearance: &Appearance) -> Vec<Option<[u8; 4]>> {
        let cloud = cloud();
        let paint = Paint::new(&cloud, appearance);
        (0..4).map(|index| paint.color(&cloud, index)).collect()
    }

    fn solid(rgb: [[u8; 3]; 4]) -> Vec<Option<[u8; 4]>> {
        rgb.into_iter()
            .map(|[r, g, b]| Some([r, g, b, 255]))
            .collect()
    }

    #[test]
    fn each_coloring_maps_its_value_to_colours() {
        let by = |coloring| {
            colors(&Appearance {
                coloring,
                up: Vec3::X,
                ..Appearance::default()
            })
        };
        assert_eq!(by(Coloring::Rgb), solid([[192; 3]; 4]));
        assert_eq!(
            by(Coloring::Label),
            solid([[50, 7, 9], [100, 7, 9], [150, 7, 9], UNKNOWN])
        );
        assert_eq!(
            by(Coloring::Confidence),
            solid([ramp(0.0), ramp(0.5), ramp(1.0), ramp(0.0)])
        );
        assert_eq!(
            by(Coloring::Normals),
            solid([[255, 128, 128], [128, 0, 128], UNKNOWN, [128, 128, 255]])
        );
        assert_eq!(
            by(Coloring::Height),
            solid([ramp(0.0), ramp(1.0 / 3.0), ramp(2.0 / 3.0), ramp(1.0)])
        );
        assert_eq!(
            by(Coloring::Conflict),
            solid([UNKNOWN; 4]),
            "the voters are not known"
        );
    }

    #[test]
    fn level_gives_parts_the_colour_of_their_ancestor() {
        let appearance = Appearance {
            coloring: Coloring::Label,
            level: Some(1),
            ..Appearance::default()
        };
        assert_eq!(
            colors(&appearance),
            solid([[50, 7, 9], [50, 7, 9], [150, 7, 9], UNKNOWN])
        );
    }

    #[test]
    fn descendants_share_the_visibility_of_hidden_and_isolated_labels() {
        let opacities = |appearance: &Appearance| -> Vec<u8> {
            colors(appearance)
                .into_iter()
                .map(|color| color.map_or(0, |color| color[3]))
                .collect()
        };
        let mut appearance = Appearance {
            hidden: BTreeSet::from([LabelId(1)]),
            ..Appearance::default()
        };
        assert_eq!(opacities(&appearance), [0, 0, 255, 255]);
        appearance = Appearance {
            isolated: Some(LabelId(1)),
            ..Appearance::default()
        };
        assert_eq!(opacities(&appearance), [255, 255, 0, 0]);
        appearance.faint = 0.2;
        assert_eq!(opacities(&appearance), [255, 255, 51, 51]);
        appearance.hidden.insert(LabelId(2));
        assert_eq!(
            opacities(&appearance),
            [255, 0, 51, 51],
            "hidden even where isolated"
        );
    }

    #[test]
    fn only_contested_points_are_opaque() {
        let opacities = |appearance: &Appearance| -> Vec<u8> {
            colors(appearance)
                .into_iter()
                .map(|color| color.map_or(0, |color| color[3]))
                .collect()
        };
        let mut appearance = Appearance {
            uncertain_below: Some(0.7),
            ..Appearance::default()
        };
        assert_eq!(
            opacities(&appearance),
            [0, 255, 0, 0],
            "the first and the last have no votes"
        );
        (appearance.faint, appearance.isolated) = (0.2, Some(LabelId(3)));
        assert_eq!(opacities(&appearance), [51, 51, 51, 51]);
        appearance.hidden.insert(LabelId(2));
        assert_eq!(opacities(&appearance), [51, 0, 51, 51]);
    }
}
