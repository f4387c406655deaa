//! Input of the steps of depth estimation.

use std::sync::Arc;

use super::images::ImagePyramids;
use super::outcome::ViewOutcome;
use super::plan::PlannedView;
use crate::stereo::Stage;
use crate::stereo::patchmatch::PosedImage;

/// A view with its image and those of its neighbouring views.
pub struct PreparedView<'a> {
    /// The view.
    pub view: &'a PlannedView,
    /// Its image.
    pub image: Arc<PosedImage>,
    /// Its neighbouring views by frame number, with their images.
    pub adjacent: Vec<(usize, Arc<PosedImage>)>,
}

impl<'a> PreparedView<'a> {
    /// Reads the input of a stage of a view. Neighbouring views whose images cannot be used are left
    /// out.
    ///
    /// Returns `None` if the view's own image cannot be used, or none of its neighbours'.
    pub fn new(
        view: &'a PlannedView,
        stage: Stage,
        images: &mut ImagePyramids<'_>,
    ) -> Option<Self> {
        let image = images.get(view.frame).ok()?;
        let adjacent = if stage == Stage::Complete {
            &view.around
        } else {
            &view.sources
        };
        let adjacent: Vec<_> = adjacent
            .iter()
            .filter_map(|&number| Some((number, images.get(number).ok()?)))
            .collect();
        if adjacent.is_empty() {
            let points = view.seeds.len();
            images.leave_out(view.frame, ViewOutcome::NothingShared { points });
            return None;
        }
        Some(Self {
            view,
            image,
            adjacent,
        })
    }
}
