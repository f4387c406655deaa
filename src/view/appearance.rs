use std::collections::BTreeSet;
use std::sync::Arc;

use glam::Vec3;

use super::Coloring;
use ostra_cloud::fuse::Votes;
use ostra_masks::{LabelId, LabelTree};

/// How points and triangles get their colours, and which of them are seen.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// What colours show.
    pub coloring: Coloring,
    /// Labels deeper than this take the colour of their ancestor there, 1 = top; `None` = every label its own.
    pub level: Option<usize>,
    /// Labels (with all below them) that are not drawn.
    pub hidden: BTreeSet<LabelId>,
    /// The label that, with all below it, is drawn as ever while all else is drawn faintly; `None` = nothing is faint.
    pub isolated: Option<LabelId>,
    /// Only points stand out whose label won less than this share of the votes ([`ostra_cloud::LabelledCloud::is_doubtful`]), 0–1, and all
    /// else is drawn faintly; `None` = all do.
    pub doubtful_below: Option<f32>,
    /// Opacity of what is faint, 0 (not drawn) to 1.
    pub faint: f32,
    /// Names and colours newer than the cloud's own.
    pub tree: Option<LabelTree>,
    /// How the points were voted on; without it, colours that show votes are grey.
    pub votes: Option<Arc<Votes>>,
    /// The direction that height is measured along, a unit vector in world space.
    pub up: Vec3,
}

impl Default for Appearance {
    fn default() -> Self {
        Self {
            coloring: Coloring::Rgb,
            level: None,
            hidden: BTreeSet::new(),
            isolated: None,
            doubtful_below: None,
            faint: 0.0,
            tree: None,
            votes: None,
            up: Vec3::NEG_Y,
        }
    }
}

impl PartialEq for Appearance {
    /// Votes are equal when they are the very same.
    fn eq(&self, other: &Self) -> bool {
        let votes = |one: &Self| one.votes.as_ref().map(Arc::as_ptr);
        (self.coloring, self.level, self.isolated) == (other.coloring, other.level, other.isolated)
            && (self.faint, self.up, self.doubtful_below)
                == (other.faint, other.up, other.doubtful_below)
            && votes(self) == votes(other)
            && self.hidden == other.hidden
            && self.tree == other.tree
    }
}
