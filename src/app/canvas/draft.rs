use std::sync::Arc;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use ostra_masks::{ElasticBorders, LabelId, Prompt, RunMask};
use ostra_project::Project;

/// Tools of the image pane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Tool {
    /// Includes and excludes by clicks, draws a box by dragging.
    Click,
    /// Paints the label.
    Brush,
    /// Erases the label.
    Eraser,
    /// Fills a polygon or a freehand outline with the label, or erases inside it.
    Polygon,
    /// Drags a border of the label.
    #[serde(alias = "Pull")]
    Border,
    /// Traces a thin structure through some points.
    #[serde(alias = "Thin")]
    Stem,
}

impl Tool {
    /// All tools in the order of the tool bar.
    pub const ALL: [Self; 6] = [
        Self::Click,
        Self::Brush,
        Self::Eraser,
        Self::Polygon,
        Self::Border,
        Self::Stem,
    ];

    /// Returns the name shown in the tool bar.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Click => "Click",
            Self::Brush => "Brush",
            Self::Eraser => "Eraser",
            Self::Polygon => "Polygon",
            Self::Border => "Move border",
            Self::Stem => "Stem & wire",
        }
    }

    /// Returns what the buttons of the pointer do over the image.
    pub(crate) fn help(self) -> &'static str {
        match self {
            Self::Click => {
                "Left click includes, right click excludes, drag draws a box, Ctrl+click labels another object"
            }
            Self::Brush => "Drag paints the label, Ctrl or the right button erases",
            Self::Eraser => "Drag erases the label",
            Self::Polygon => "Click adds a corner, drag draws freely, double click fills",
            Self::Border => "Press on the border of the label and drag it",
            Self::Stem => "Click along the stem from one end to the other, double click ends",
        }
    }
}

/// Brush stroke, in image pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Stroke {
    /// Index of the painted frame.
    pub frame: usize,
    /// Label that is painted or erased.
    pub label: LabelId,
    /// Whether the stroke erases instead of painting.
    pub erase: bool,
    /// Vertices of the stroke.
    pub points_px: Vec<DVec2>,
    /// Radius of the brush.
    pub radius_px: f64,
    /// Whether the stroke stops at image edges.
    pub snap: bool,
}

/// Border that is being dragged.
#[derive(Debug, Clone)]
pub struct HeldBorder {
    /// Frame of the mask.
    pub frame: usize,
    /// Label that the border belongs to.
    pub label: LabelId,
    /// All borders of the label.
    pub borders: ElasticBorders,
    /// Dragged point on the border, in image pixels.
    pub from_px: DVec2,
    /// Position of the press, a little off the border.
    pub pressed_px: DVec2,
    /// Mask that the borders were extracted from.
    pub of: Arc<RunMask>,
}

impl HeldBorder {
    /// Returns the target of the dragged point for a pointer position; `None` below one pixel.
    #[must_use]
    pub fn to_px(&self, pointer_px: DVec2) -> Option<DVec2> {
        let way = pointer_px - self.pressed_px;
        (way.length() >= 1.0).then_some(self.from_px + way)
    }
}

/// Drawing in progress, and prompts and strokes sent but not yet applied to the project.
#[derive(Debug, Clone, Default)]
pub struct Draft {
    /// Where the primary button was pressed on the image, in screen points, while it is down.
    pub pressed: Option<egui::Pos2>,
    /// Corner where the box started.
    pub box_from: Option<DVec2>,
    /// Stroke in progress.
    pub stroke: Option<Stroke>,
    /// Vertices of the polygon or thin structure so far.
    pub corners: Vec<DVec2>,
    /// Freehand outline drawn with the button held, an alternative to single vertices.
    pub lasso: Option<Vec<DVec2>>,
    /// Border being dragged.
    pub held: Option<HeldBorder>,
    /// Latest prompt sent. The next click extends it even before the project contains it.
    sent_prompt: Option<(usize, LabelId, Prompt)>,
    /// Latest stroke sent and the mask under it. The stroke is shown until that mask changes.
    sent_stroke: Option<(Stroke, Option<Arc<RunMask>>)>,
}

impl Draft {
    /// Returns `true` if a box, stroke, outline or border drag is in progress.
    #[must_use]
    pub fn is_half_made(&self) -> bool {
        let drawn = !self.corners.is_empty() || self.lasso.is_some();
        self.box_from.is_some() || self.stroke.is_some() || drawn || self.held.is_some()
    }

    /// Drops the drawing in progress; returns `false` if there was none.
    pub fn drop_half_made(&mut self) -> bool {
        let had = self.is_half_made();
        self.pressed = None;
        self.box_from = None;
        self.stroke = None;
        self.corners.clear();
        self.lasso = None;
        self.held = None;
        had
    }

    /// Drops what was sent but not applied, for example after undo, redo or an error.
    pub fn forget_sent(&mut self) {
        self.sent_prompt = None;
        self.sent_stroke = None;
    }

    /// Returns the prompt of a label on a frame, including what was sent but not yet applied.
    #[must_use]
    pub fn prompt(&self, project: &Project, frame: usize, label: LabelId) -> Prompt {
        match &self.sent_prompt {
            Some((sent_frame, sent_label, prompt))
                if (*sent_frame, *sent_label) == (frame, label) =>
            {
                prompt.clone()
            }
            _ => project
                .prompts
                .get(&(frame, label))
                .cloned()
                .unwrap_or_default(),
        }
    }

    /// Returns `true` if a sent prompt or stroke is not yet applied to the project.
    #[must_use]
    pub fn is_sending(&self) -> bool {
        self.sent_prompt.is_some() || self.sent_stroke.is_some()
    }

    /// Records a prompt that was sent.
    pub fn sent(&mut self, frame: usize, label: LabelId, prompt: Prompt) {
        self.sent_prompt = Some((frame, label, prompt));
    }

    /// Records a stroke that was sent.
    pub fn sent_stroke(&mut self, stroke: Stroke, project: &Project) {
        let over = project
            .masks
            .get(&stroke.frame)
            .map(|mask| Arc::clone(&mask.runs));
        self.sent_stroke = Some((stroke, over));
    }

    /// Drops sent prompts and strokes that the project now contains, and outdated border drags.
    pub fn follow(&mut self, project: &Project) {
        if let Some((frame, label, prompt)) = &self.sent_prompt
            && project
                .prompts
                .get(&(*frame, *label))
                .unwrap_or(&Prompt::default())
                .gives_as(prompt)
        {
            self.sent_prompt = None;
        }
        let is_of = |held: &HeldBorder| {
            project
                .masks
                .get(&held.frame)
                .is_some_and(|now| Arc::ptr_eq(&now.runs, &held.of))
        };
        if !self.held.as_ref().is_none_or(is_of) {
            self.held = None;
        }
        if let Some((stroke, over)) = &self.sent_stroke {
            let now = project.masks.get(&stroke.frame).map(|mask| &mask.runs);
            let same = match (now, over) {
                (Some(now), Some(over)) => Arc::ptr_eq(now, over),
                (None, None) => true,
                _ => false,
            };
            if !same {
                self.sent_stroke = None;
            }
        }
    }

    /// Returns the strokes to draw over the mask of a frame.
    pub fn strokes(&self, frame: usize) -> impl Iterator<Item = &Stroke> {
        let sent = self.sent_stroke.as_ref().map(|(stroke, _)| stroke);
        self.stroke
            .iter()
            .chain(sent)
            .filter(move |stroke| stroke.frame == frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_masks::Click;

    #[test]
    fn clicks_extend_the_sent_prompt_until_it_is_applied() {
        let (mut draft, mut project) = (Draft::default(), Project::default());
        let label = LabelId(1);
        let one = Prompt {
            clicks: vec![Click {
                at_px: DVec2::ONE,
                include: true,
            }],
            ..Prompt::default()
        };
        draft.sent(3, label, one.clone());
        assert_eq!(draft.prompt(&project, 3, label), one);
        assert!(draft.prompt(&project, 4, label).is_empty());
        // The project adds to the prompt whether its clicks correct an existing mask.
        project.prompts.insert(
            (3, label),
            Prompt {
                corrects: true,
                ..one
            },
        );
        draft.follow(&project);
        project.prompts.remove(&(3, label));
        assert!(
            draft.prompt(&project, 3, label).is_empty(),
            "undo is believed"
        );
    }
}
