//! A question with a known answer for trackers: a moving disc.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::synthetic_images::moving_disc;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore, Image, ImageSource, Orientation};
use ostra_masks::{
    Direction, LabelId, LabelMask, MaskError, Region, TrackRequest, TrackedFrame, Tracker,
};

/// Number of frames; the first one is given.
const FRAMES: u32 = 8;
/// Bytes of decoded images that are kept.
const KEPT_BYTES: usize = 16 << 20;
const DISC: LabelId = LabelId(1);

/// Returns the mean IoU with a moving disc on the frames after the first one.
///
/// # Errors
/// Fails if the tracker does, or if no temporary folder can be written.
pub(crate) fn tracked_disc_iou(
    tracker: &dyn Tracker,
    progress: &Progress,
) -> Result<f64, MaskError> {
    let scratch = tempfile::tempdir().map_err(|error| MaskError::Request(error.to_string()))?;
    let (mut frames, mut truth) = (Vec::new(), Vec::new());
    for at in 0..FRAMES {
        let (image, disc) = moving_disc(at);
        let path = scratch.path().join(format!("{at}.png"));
        save(&image, &path).map_err(|error| MaskError::Request(error.to_string()))?;
        let source = ImageSource::File {
            path,
            orientation: Orientation::default(),
        };
        frames.push(Frame {
            name: at.to_string(),
            width: image.width,
            height: image.height,
            image: source,
            depth: None,
            camera: None,
        });
        truth.push(disc.region());
    }
    let request = TrackRequest {
        frames: Arc::new(frames),
        store: Arc::new(FrameStore::new(KEPT_BYTES)),
        keyframes: BTreeMap::from([(0, Arc::new(mask_of(&truth[0])))]),
        from: 0,
        to: FRAMES as usize - 1,
        direction: Direction::Forward,
        labels: None,
    };
    let mut tracked = BTreeMap::new();
    let mut take = |frame: TrackedFrame| drop(tracked.insert(frame.frame, frame.mask));
    tracker.track(&request, &mut take, progress)?;
    let iou = |(number, truth): (usize, &Region)| {
        let found = tracked.get(&number);
        found.map_or(0.0, |mask| region_of(mask).iou(truth))
    };
    let sum: f64 = truth.iter().enumerate().skip(1).map(iou).sum();
    Ok(sum / f64::from(FRAMES - 1))
}

fn save(image: &Image, path: &std::path::Path) -> image::ImageResult<()> {
    let bytes = image.pixels.as_flattened();
    image::save_buffer(
        path,
        bytes,
        image.width,
        image.height,
        image::ExtendedColorType::Rgb8,
    )
}

fn mask_of(region: &Region) -> LabelMask {
    let mut mask = LabelMask::empty(region.width, region.height);
    for (id, &is_inside) in mask.ids.iter_mut().zip(&region.inside) {
        if is_inside {
            *id = DISC;
        }
    }
    mask
}

fn region_of(mask: &LabelMask) -> Region {
    Region {
        width: mask.width,
        height: mask.height,
        inside: mask.ids.iter().map(|&id| id == DISC).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_tracking::flow::FlowTracker;

    /// Returns the mask of the first frame for all others.
    struct Still;

    impl Tracker for Still {
        fn name(&self) -> &'static str {
            "still"
        }

        fn track(
            &self,
            request: &TrackRequest,
            emit: &mut dyn FnMut(TrackedFrame),
            _: &Progress,
        ) -> Result<Vec<String>, MaskError> {
            for frame in 1..=request.to {
                emit(TrackedFrame {
                    frame,
                    mask: LabelMask::clone(&request.keyframes[&0]),
                    confidence: BTreeMap::new(),
                    preliminary: false,
                });
            }
            Ok(Vec::new())
        }
    }

    #[test]
    fn moving_disc_distinguishes_trackers() {
        let progress = Progress::default();
        let flow = tracked_disc_iou(&FlowTracker::default(), &progress).unwrap();
        assert!(flow > 0.85, "{flow}");
        let still = tracked_disc_iou(&Still, &progress).unwrap();
        assert!(still < 0.4, "{still}");
    }
}
