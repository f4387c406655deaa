use std::sync::Arc;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use ostra_masks::{ElasticBorders, LabelId, Prompt, RunMask};
use ostra_project::Project;

/// What the pointer does on the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Tool {
    /// Clicks include and exclude, dragging makes a box.
    Click,
    /// Paints the label.
    Brush,
    /// Takes the label away.
    Eraser,
    /// Fills a polygon or what is drawn around with the label, or takes it away there.
    Polygon,
    /// Drags a border of the label.
    Pull,
    /// Gives a thin structure through some points to the label.
    Thin,
}

impl Tool {
    /// All tools in the order of the tool bar.
    pub const ALL: [Self; 6] = [
        Self::Click,
        Self::Brush,
        Self::Eraser,
        Self::Polygon,
        Self::Pull,
        Self::Thin,
    ];

    /// What the tool bar shows.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Click => "Click",
            Self::Brush => "Brush",
            Self::Eraser => "Eraser",
            Self::Polygon => "Polygon",
            Self::Pull => "Move border",
            Self::Thin => "Stem & wire",
        }
    }
}

/// A line of the brush, in picture pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Stroke {
    /// Frame painted on.
    pub frame: usize,
    /// Label painted or taken away.
    pub label: LabelId,
    /// Takes away instead of painting.
    pub erase: bool,
    /// Corners.
    pub points_px: Vec<DVec2>,
    /// Radius of the brush.
    pub radius_px: f64,
    /// Stops at the picture's edges.
    pub snap: bool,
}

/// A border that is being dragged.
#[derive(Debug, Clone)]
pub struct HeldBorder {
    /// Frame of the mask.
    pub frame: usize,
    /// Label whose border it is.
    pub label: LabelId,
    /// All borders of the label.
    pub borders: ElasticBorders,
    /// The place on them that is held, in picture pixels.
    pub from_px: DVec2,
    /// Where it was pressed, a little beside the border.
    pub pressed_px: DVec2,
    /// The mask whose borders they are.
    pub of: Arc<RunMask>,
}

impl HeldBorder {
    /// Where the border is pulled to while the pointer is at a place; `None` for less than a pixel.
    #[must_use]
    pub fn to_px(&self, pointer_px: DVec2) -> Option<DVec2> {
        let way = pointer_px - self.pressed_px;
        (way.length() >= 1.0).then_some(self.from_px + way)
    }
}

/// What is being drawn, and what was sent but is not in the project yet.
#[derive(Debug, Clone, Default)]
pub struct Draft {
    /// Corner where the box began.
    pub box_from: Option<DVec2>,
    /// The stroke in hand.
    pub stroke: Option<Stroke>,
    /// Corners of the polygon, or points of the thin structure, so far.
    pub corners: Vec<DVec2>,
    /// What is drawn with the button held, in place of corners.
    pub lasso: Option<Vec<DVec2>>,
    /// The border in hand.
    pub held: Option<HeldBorder>,
    /// The latest prompt sent: the next click builds on it, before the project has it.
    sent_prompt: Option<(usize, LabelId, Prompt)>,
    /// The latest stroke sent, with the mask it was painted over: shown until the mask changes.
    sent_stroke: Option<(Stroke, Option<Arc<RunMask>>)>,
}

impl Draft {
    /// Whether a box, stroke or line of points is being drawn, or a border dragged.
    #[must_use]
    pub fn is_half_made(&self) -> bool {
        let drawn = !self.corners.is_empty() || self.lasso.is_some();
        self.box_from.is_some() || self.stroke.is_some() || drawn || self.held.is_some()
    }

    /// Drops what is half made; `false` when there was nothing.
    pub fn drop_half_made(&mut self) -> bool {
        let had = self.is_half_made();
        self.box_from = None;
        self.stroke = None;
        self.corners.clear();
        self.lasso = None;
        self.held = None;
        had
    }

    /// Forgets what was sent: after undo, redo or an error.
    pub fn forget_sent(&mut self) {
        self.sent_prompt = None;
        self.sent_stroke = None;
    }

    /// All that is given for a label on a frame, as the user sees it.
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

    /// Whether something was sent that has not arrived in the project yet.
    #[must_use]
    pub fn is_sending(&self) -> bool {
        self.sent_prompt.is_some() || self.sent_stroke.is_some()
    }

    /// Remembers a prompt that was sent.
    pub fn sent(&mut self, frame: usize, label: LabelId, prompt: Prompt) {
        self.sent_prompt = Some((frame, label, prompt));
    }

    /// Remembers a stroke that was sent.
    pub fn sent_stroke(&mut self, stroke: Stroke, project: &Project) {
        let over = project
            .masks
            .get(&stroke.frame)
            .map(|mask| Arc::clone(&mask.runs));
        self.sent_stroke = Some((stroke, over));
    }

    /// Forgets what was sent and has arrived in the project.
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

    /// The strokes to show over the mask of a frame.
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
    fn clicks_build_on_what_was_sent_until_the_project_has_it() {
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
        // The project notes beside it what the clicks were given on.
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
