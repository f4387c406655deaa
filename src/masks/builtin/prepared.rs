use std::sync::Arc;

use super::appearance::Palette;
use super::graph::RegionGraph;
use super::mend::mended;
use super::query::Query;
use super::raster::Raster;
use crate::{Click, MaskError, PreparedFrame, PxBox, Region, SegmentRequest};
use ostra_core::job::Progress;
use ostra_frames::Image;

/// A frame with everything worked out that no prompt is needed for.
pub(super) struct Prepared {
    pub raster: Raster,
    pub graph: RegionGraph,
    pub palette: Palette,
    /// The picture, where there is no depth by which to tell things apart.
    pub flat: Option<Arc<Image>>,
}

impl PreparedFrame for Prepared {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        _progress: &Progress,
    ) -> Result<Region, MaskError> {
        self.check(request)?;
        let SegmentRequest {
            prompt,
            previous,
            taken,
        } = *request;
        // With an answer to refine only the last click is new.
        if let (Some(previous), Some(last)) = (previous, prompt.clicks.len().checked_sub(1)) {
            let flat = self.flat.as_ref().filter(|_| prompt.corrects);
            let mended = flat.and_then(|image| {
                mended(image, self.raster.factor, previous, &prompt.clicks, taken)
            });
            return Ok(
                mended.unwrap_or_else(|| self.refined(previous, &prompt.clicks, last, taken))
            );
        }
        let mut boxed = Query::new(self, taken);
        boxed.add_boxes(&prompt.boxes);
        let clicks = 0..prompt.clicks.len();
        Ok(clicks.fold(boxed.answer(), |answer, at| {
            self.refined(&answer, &prompt.clicks, at, taken)
        }))
    }

    fn bytes(&self) -> usize {
        let picture = self
            .flat
            .as_ref()
            .map_or(0, |image| size_of_val(&*image.pixels));
        self.raster.bytes() + self.graph.bytes() + self.palette.bytes() + picture
    }
}

impl Prepared {
    /// The `previous` answer, to the clicks before `at`, refined by the click there; later clicks are not looked at.
    fn refined(
        &self,
        previous: &Region,
        clicks: &[Click],
        at: usize,
        taken: Option<&Region>,
    ) -> Region {
        let mut query = Query::new(self, taken);
        query.start_from(previous);
        clicks[..at]
            .iter()
            .for_each(|click| query.add_known_click(click));
        query.add_click(&clicks[at]);
        query.answer()
    }

    fn check(&self, request: &SegmentRequest<'_>) -> Result<(), MaskError> {
        let (width, height) = (self.raster.width, self.raster.height);
        if request.prompt.is_empty() {
            return Err(MaskError::Request(
                "there is no click and no box; click on the object first".into(),
            ));
        }
        let inside = |click: &Click| {
            let at = click.at_px;
            at.x >= 0.0 && at.y >= 0.0 && at.x < width as f64 && at.y < height as f64
        };
        if let Some(click) = request.prompt.clicks.iter().find(|click| !inside(click)) {
            return Err(MaskError::Request(format!(
                "the click at {}, {} lies outside the picture of {width}×{height}; click inside it",
                click.at_px.x, click.at_px.y
            )));
        }
        let crosses = |part: &PxBox| {
            part.max_px.x > part.min_px.x.max(0.0)
                && part.max_px.y > part.min_px.y.max(0.0)
                && part.min_px.x < width as f64
                && part.min_px.y < height as f64
        };
        if let Some(part) = request.prompt.boxes.iter().find(|part| !crosses(part)) {
            return Err(MaskError::Request(format!(
                "the box from {}, {} to {}, {} holds no pixel of the picture of {width}×{height}; draw it inside",
                part.min_px.x, part.min_px.y, part.max_px.x, part.max_px.y
            )));
        }
        let fits = |region: &Region| {
            region.width as usize == width
                && region.height as usize == height
                && region.inside.len() == width * height
        };
        if [request.previous, request.taken]
            .into_iter()
            .flatten()
            .all(fits)
        {
            Ok(())
        } else {
            Err(MaskError::Request(format!(
                "a mask given does not have the picture's size of {width}×{height}"
            )))
        }
    }
}
