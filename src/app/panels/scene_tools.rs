//! Tools of the 3-D view: point selection, point inspector and ruler.

use std::sync::Arc;

use egui::Pos2;
use glam::{DVec2, Vec3};

use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::{Voter, Votes};
use ostra_cloud::measure::{Dimension, GroundChoice, LengthUnit};
use ostra_cloud::select::{Likeness, SelectStep};
use ostra_masks::LabelId;
use ostra_project::{ScaleEnd, ScaleRequest};
use ostra_session::{CloudChange, CloudCorrection, Command};
use ostra_view::LineVertex;

/// Maximum distance in pixels between an image position and the point visible there.
const NEAR_PX: f64 = 3.0;

/// Inspected point of the cloud with its votes.
#[derive(Debug, Clone)]
pub struct InspectedPoint {
    pub(super) cloud: Arc<LabelledCloud>,
    pub(super) point: usize,
    pub(super) votes: Vec<(LabelId, u16)>,
    pub(super) voters: Vec<Voter>,
}

impl InspectedPoint {
    /// Inspects a point by its index.
    #[must_use]
    pub fn new(cloud: &Arc<LabelledCloud>, votes: Option<&Arc<Votes>>, point: usize) -> Self {
        let histogram = votes
            .map(|votes| votes.histogram(point).to_vec())
            .unwrap_or_default();
        let mut voters = votes.map(|votes| votes.voters(point)).unwrap_or_default();
        // The user looks for contradicting voters, so they come first and frames without a mask
        // last.
        voters.sort_by_key(|voter| match voter.label {
            Some(label) if label != cloud.labels[point] => 0,
            Some(_) => 1,
            None => 2,
        });
        Self {
            cloud: Arc::clone(cloud),
            point,
            votes: histogram,
            voters,
        }
    }

    /// Inspects the point visible nearest to an image position of a frame.
    ///
    /// Returns `None` if no point is within 3 pixels.
    #[must_use]
    pub fn seen_at(
        cloud: &Arc<LabelledCloud>,
        votes: &Arc<Votes>,
        frame: usize,
        at_px: DVec2,
    ) -> Option<Self> {
        let off = |x: u32, y: u32| middle(x, y).distance_squared(at_px);
        let near = votes
            .observations(frame)
            .filter(|&(_, x, y)| off(x, y) <= NEAR_PX * NEAR_PX);
        let (point, ..) = near.min_by(|a, b| off(a.1, a.2).total_cmp(&off(b.1, b.2)))?;
        Some(Self::new(cloud, Some(votes), point))
    }

    /// Returns the position of the point, in world units.
    #[must_use]
    pub fn place(&self) -> Vec3 {
        self.cloud.positions[self.point]
    }

    /// Returns the image position of the point in a frame, if it is visible there.
    #[must_use]
    pub fn seen_in(&self, frame: usize) -> Option<DVec2> {
        self.voters
            .iter()
            .find(|voter| voter.frame == frame)
            .map(|voter| middle(voter.x, voter.y))
    }

    /// Returns the same point of another cloud with its votes.
    ///
    /// Returns `None` if that cloud has other points.
    #[must_use]
    pub fn on(self, cloud: &Arc<LabelledCloud>, votes: Option<&Arc<Votes>>) -> Option<Self> {
        if Arc::ptr_eq(cloud, &self.cloud) {
            return Some(self);
        }
        let same = cloud.len() == self.cloud.len() && cloud.positions[self.point] == self.place();
        same.then(|| Self::new(cloud, votes, self.point))
    }
}

pub(super) fn middle(x: u32, y: u32) -> DVec2 {
    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// Shape drawn to select points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SelectShape {
    /// Closed freehand outline.
    #[default]
    Lasso,
    /// Box from corner to corner.
    Box,
    /// Brush stroke.
    Brush,
}

/// Selection of points in the 3-D view and the settings for correcting them.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneSelect {
    /// Whether drags in the 3-D view select points.
    pub in_hand: bool,
    /// Shape that a drag draws.
    pub shape: SelectShape,
    /// Radius of the brush in screen points.
    pub brush: f32,
    /// Similarity required of points when the selection grows.
    pub likeness: Likeness,
    /// Part to keep, counted from 1.
    pub piece: usize,
    /// Whether frames changed by a correction become keyframes.
    pub as_keyframes: bool,
    /// Steps that make up the selection.
    pub steps: Vec<SelectStep>,
    /// Outline being drawn, in screen positions.
    pub(super) drawn: Vec<Pos2>,
}

impl Default for SceneSelect {
    fn default() -> Self {
        Self {
            in_hand: false,
            shape: SelectShape::Lasso,
            brush: 14.0,
            likeness: Likeness::default(),
            piece: 1,
            as_keyframes: false,
            steps: Vec::new(),
            drawn: Vec::new(),
        }
    }
}

impl SceneSelect {
    /// Cancels the outline being drawn, else the selection, else the tool.
    ///
    /// Returns `false` if there was nothing to cancel.
    pub fn cancel(&mut self) -> bool {
        let was_any = self.in_hand || !self.steps.is_empty();
        if !self.drawn.is_empty() {
            self.drawn.clear();
        } else if !self.steps.is_empty() {
            self.steps.clear();
        } else {
            self.in_hand = false;
        }
        was_any
    }

    /// Returns the correction of the selected points and clears the selection.
    ///
    /// Returns `None` if nothing is selected.
    pub fn correct(&mut self, change: CloudChange) -> Option<Command> {
        let select = std::mem::take(&mut self.steps);
        let correction = CloudCorrection {
            select,
            change,
            as_keyframes: self.as_keyframes,
        };
        (!correction.select.is_empty()).then_some(Command::CorrectCloud(correction))
    }

    /// Returns the vertices of the outline, or the points of the stroke.
    pub(super) fn outline(&self) -> Vec<Pos2> {
        match (self.shape, self.drawn.first(), self.drawn.last()) {
            (SelectShape::Box, Some(&from), Some(&to)) => {
                let [a, b] = [Pos2::new(to.x, from.y), Pos2::new(from.x, to.y)];
                vec![from, a, to, b]
            }
            _ => self.drawn.clone(),
        }
    }
}

const COLOR: [u8; 4] = [255, 90, 90, 255];

/// Quantity measured by the ruler.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RulerKind {
    /// Length of the line through all points, for two points their distance.
    #[default]
    Length,
    /// Angle at the second of three points.
    Angle,
}

/// Points of the ruler, and the known distance between the first two.
#[derive(Debug, Clone, PartialEq)]
pub struct Ruler {
    /// Whether clicks in the 3-D view add points.
    pub in_hand: bool,
    /// Measured quantity.
    pub kind: RulerKind,
    /// Points in world units, in the order of the clicks.
    pub points: Vec<Vec3>,
    /// Known length; 0 if not given yet.
    pub length: f64,
    /// Unit of the known length.
    pub length_unit: LengthUnit,
}

impl Default for Ruler {
    fn default() -> Self {
        Self {
            in_hand: false,
            kind: RulerKind::Length,
            points: Vec::new(),
            length: 0.0,
            // Known lengths in a scene are mostly those of a ruler or a marker.
            length_unit: LengthUnit::Centimetre,
        }
    }
}

impl Ruler {
    /// Takes the ruler in hand to measure a known length.
    pub fn start(&mut self) {
        (self.in_hand, self.kind) = (true, RulerKind::Length);
        self.points.clear();
    }

    /// Adds a point; the fourth point of an angle starts a new one.
    pub fn click(&mut self, at: Vec3) {
        if self.kind == RulerKind::Angle && self.points.len() >= 3 {
            self.points.clear();
        }
        self.points.push(at);
    }

    /// Removes the last point.
    pub fn undo_click(&mut self) {
        self.points.pop();
    }

    /// Returns a length in world units or an angle in degrees, 0–180.
    ///
    /// Returns `None` if there are too few points.
    #[must_use]
    pub fn value(&self) -> Option<(f64, Dimension)> {
        match (self.kind, &self.points[..]) {
            (RulerKind::Length, points @ [_, _, ..]) => {
                let steps = points
                    .windows(2)
                    .map(|pair| pair[0].as_dvec3().distance(pair[1].as_dvec3()));
                Some((steps.sum(), Dimension::Length))
            }
            (RulerKind::Angle, &[a, corner, b, ..]) => {
                let [a, b] = [a, b].map(|end| (end - corner).as_dvec3());
                let angle = a.angle_between(b).to_degrees();
                angle.is_finite().then_some((angle, Dimension::Angle))
            }
            _ => None,
        }
    }

    /// Returns the plane through exactly three points, with its normal on the side of `up`.
    ///
    /// Returns `None` for another number of points or if they lie on a line.
    #[must_use]
    pub fn plane(&self, up: Vec3) -> Option<GroundChoice> {
        let [a, b, c] = self.points[..] else {
            return None;
        };
        let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let normal = if normal.dot(up.as_dvec3()) < 0.0 {
            -normal
        } else {
            normal
        };
        Some(GroundChoice::Plane {
            normal: normal.to_array(),
            offset: normal.dot(a),
        })
    }

    /// Returns the ruler's line, and a cross of `size` world units at each point.
    #[must_use]
    pub fn lines(&self, size: f32) -> Vec<LineVertex> {
        let line = |a: Vec3, b: Vec3| {
            [a, b].map(|end| LineVertex {
                position: end.to_array(),
                color: COLOR,
            })
        };
        let cross = |&at: &Vec3| {
            [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| line(at - size * axis, at + size * axis))
        };
        let crosses = self.points.iter().flat_map(cross).flatten();
        let between = self
            .points
            .windows(2)
            .flat_map(|pair| line(pair[0], pair[1]));
        crosses.chain(between).collect()
    }

    /// Returns the command that sets the scale; `None` before the length of two points is known.
    #[must_use]
    pub fn command(&self) -> Option<Command> {
        let (RulerKind::Length, &[a, b]) = (self.kind, &self.points[..]) else {
            return None;
        };
        let ends = [a, b].map(|end| ScaleEnd::World(end.as_dvec3()));
        let length = self.length_unit.metres(self.length);
        (length > 0.0 && a != b).then_some(Command::Scale(ScaleRequest { ends, length }))
    }

    /// Multiplies the points by `factor` after the scene was rescaled.
    pub fn scale_by(&mut self, factor: f64) {
        for point in &mut self.points {
            *point = (point.as_dvec3() * factor).as_vec3();
        }
    }

    pub(super) fn hint(&self) -> &'static str {
        match (self.kind, self.points.len()) {
            (RulerKind::Length, 0) => "Click the first point",
            (RulerKind::Length, _) => "Click the next point",
            (RulerKind::Angle, 0) => "Click a point on one leg",
            (RulerKind::Angle, 1) => "Click the corner",
            (RulerKind::Angle, _) => "Click a point on the other leg",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_sums_segments_and_angle_is_at_second_point() {
        let mut ruler = Ruler::default();
        for at in [Vec3::ZERO, 3.0 * Vec3::X, 3.0 * Vec3::X + 4.0 * Vec3::Y] {
            ruler.click(at);
        }
        assert_eq!(ruler.value(), Some((7.0, Dimension::Length)));
        ruler.length = 2.0;
        assert_eq!(ruler.command(), None, "a scale is set by two points");
        ruler.kind = RulerKind::Angle;
        assert_eq!(ruler.value(), Some((90.0, Dimension::Angle)));
        ruler.kind = RulerKind::Length;
        ruler.undo_click();
        assert_eq!(ruler.value(), Some((3.0, Dimension::Length)));
        assert!(ruler.command().is_some());
        ruler.undo_click();
        assert_eq!(ruler.value(), None);
    }

    #[test]
    fn three_points_define_a_plane_with_normal_towards_up() {
        let mut ruler = Ruler {
            points: vec![Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + Vec3::Y],
            ..Ruler::default()
        };
        let plane = |z, offset| {
            Some(GroundChoice::Plane {
                normal: [0.0, 0.0, z],
                offset,
            })
        };
        assert_eq!(ruler.plane(Vec3::Z), plane(1.0, 1.0));
        assert_eq!(ruler.plane(Vec3::new(0.3, 0.0, -1.0)), plane(-1.0, -1.0));
        ruler.points[2] = Vec3::Z + 3.0 * Vec3::X;
        assert_eq!(ruler.plane(Vec3::Z), None, "three in a row");
        ruler.undo_click();
        assert_eq!(ruler.plane(Vec3::Z), None);
    }

    #[test]
    fn fourth_point_of_an_angle_starts_a_new_one() {
        let mut ruler = Ruler {
            kind: RulerKind::Angle,
            ..Ruler::default()
        };
        (0..4).for_each(|k| ruler.click(Vec3::splat(k as f32)));
        assert_eq!(ruler.points, [Vec3::splat(3.0)]);
    }
}
