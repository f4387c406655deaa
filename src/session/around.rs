use anyhow::{Result, ensure};
use ostra_project::{MaskOrigin, Project};

use crate::TrackSettings;

impl TrackSettings {
    /// The same from the anchor before `frame` to the anchor after it (both excluded; the sequence's end where there is
    /// none): what a correction of that frame can better.
    ///
    /// # Errors
    /// When the frame is not there or no anchor, or both its neighbours are anchors.
    pub fn around(self, project: &Project, frame: usize) -> Result<Self> {
        project.frame(frame)?;
        let is_anchor = project
            .masks
            .get(&frame)
            .is_some_and(|mask| mask.origin == MaskOrigin::Anchor);
        ensure!(
            is_anchor,
            "frame {frame} is no anchor; prompt, paint or accept its mask first"
        );
        let (before, after) = project.neighbour_anchors(frame);
        let from = before.map_or(0, |anchor| anchor + 1);
        let to = after.unwrap_or(project.frames.len()) - 1;
        ensure!(
            from < to,
            "around frame {frame} there is nothing to track: the frames next to it are anchors too"
        );
        Ok(Self {
            from: Some(from),
            to: Some(to),
            ..self
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_project::Edit;
    use ostra_project::testing::{anchor, project, tracked};

    #[test]
    fn a_correction_reaches_from_anchor_to_anchor() {
        let mut project = project();
        let around = |project: &Project, frame| {
            let settings = TrackSettings::default().around(project, frame);
            settings
                .map(|settings| (settings.from.unwrap(), settings.to.unwrap()))
                .map_err(|error| error.to_string())
        };
        let set = |project: &mut Project, frame, mask| {
            project
                .apply(Edit::SetMask {
                    frame,
                    mask: Some(mask),
                })
                .unwrap()
        };
        set(&mut project, 1, anchor([1, 0, 0]));
        set(&mut project, 2, tracked([1, 0, 0]));
        assert_eq!(around(&project, 1), Ok((0, 4)));
        assert!(around(&project, 2).unwrap_err().contains("no anchor"));
        assert!(around(&project, 5).unwrap_err().contains("frames 0 to 4"));
        set(&mut project, 3, anchor([1, 0, 0]));
        assert_eq!(
            (around(&project, 1), around(&project, 3)),
            (Ok((0, 2)), Ok((2, 4)))
        );
        set(&mut project, 4, anchor([1, 0, 0]));
        set(&mut project, 2, anchor([1, 0, 0]));
        assert!(
            around(&project, 3)
                .unwrap_err()
                .contains("nothing to track")
        );
    }
}
