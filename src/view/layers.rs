use std::sync::Arc;

use super::style::ramp;
use ostra_core::statistics::trimmed_range;
use ostra_frames::{DepthMap, EstimatedDepth, Frame, FrameError, FrameStore, Image};

/// A layer of a frame that can be displayed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Layer {
    /// The image.
    #[default]
    Image,
    /// Depth: near is violet, far is yellow.
    Depth,
    /// Normals as colours: red is right, green is down, blue is towards the camera.
    Normals,
    /// Confidence of the depth: 0 is violet, 1 is yellow.
    Confidence,
}

/// A layer rendered as an image of the frame's size.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerImage {
    /// The rendered image; unknown pixels are dark grey.
    pub image: Arc<Image>,
    /// Values at the ends of the colour ramp: world units for depth, 0–1 for confidence.
    ///
    /// `None` for layers without a ramp.
    pub range: Option<[f32; 2]>,
}

impl Layer {
    /// All layers, the image first.
    pub const ALL: [Self; 4] = [Self::Image, Self::Depth, Self::Normals, Self::Confidence];

    /// Returns the display name.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Image => "Image",
            Self::Depth => "Depth",
            Self::Normals => "Normals",
            Self::Confidence => "Confidence",
        }
    }
}

const UNKNOWN: [u8; 3] = [40, 40, 40];
/// Quantile of the depths at each end of the colour ramp.
///
/// Cutting the extremes prevents a few far pixels from using up the range of colours.
const QUANTILE: f64 = 0.01;

/// Renders a layer of a frame; `None` if the frame does not have it.
///
/// # Errors
/// Returns [`FrameError`] if the layer cannot be read.
pub fn draw_layer(
    layer: Layer,
    frame: &Frame,
    store: &FrameStore,
) -> Result<Option<LayerImage>, FrameError> {
    Ok(match layer {
        Layer::Image => Some(LayerImage {
            image: store.image(frame)?,
            range: None,
        }),
        Layer::Depth => store.depth(frame)?.map(|depth| draw_depth(&depth)),
        Layer::Normals => store
            .estimated_depth(frame)?
            .map(|made| draw_normals(&made, frame)),
        Layer::Confidence => store
            .estimated_depth(frame)?
            .map(|made| draw_confidence(&made, frame)),
    })
}

fn draw_depth(depth: &DepthMap) -> LayerImage {
    let mut known: Vec<f32> = depth
        .depths
        .iter()
        .copied()
        .filter(|&depth| depth > 0.0)
        .collect();
    let skipped = (QUANTILE * known.len() as f64) as usize;
    let range = trimmed_range(&mut known, skipped);
    let [near, far] = range.unwrap_or([0.0, 1.0]);
    let color = |&depth: &f32| match depth {
        depth if depth > 0.0 => ramp((depth - near) / (far - near).max(f32::MIN_POSITIVE)),
        _ => UNKNOWN,
    };
    let pixels = depth.depths.iter().map(color).collect();
    LayerImage {
        image: Arc::new(Image {
            width: depth.width,
            height: depth.height,
            pixels,
        }),
        range,
    }
}

fn draw_normals(made: &EstimatedDepth, frame: &Frame) -> LayerImage {
    let color = |at: usize| match made.normals[at] {
        [0, 0, 0] => UNKNOWN,
        [x, y, z] => [x, y, -z.max(-127)].map(|along| (i16::from(along) + 128) as u8),
    };
    LayerImage {
        image: Arc::new(seen(made, frame, color)),
        range: None,
    }
}

fn draw_confidence(made: &EstimatedDepth, frame: &Frame) -> LayerImage {
    let color = |at: usize| match made.depth.depths[at] {
        depth if depth > 0.0 => ramp(f32::from(made.confidence[at]) / 255.0),
        _ => UNKNOWN,
    };
    LayerImage {
        image: Arc::new(seen(made, frame, color)),
        range: Some([0.0, 1.0]),
    }
}

fn seen(made: &EstimatedDepth, frame: &Frame, color: impl Fn(usize) -> [u8; 3]) -> Image {
    let pixels = made
        .pixels_seen_by(frame)
        .map(|at| at.map_or(UNKNOWN, &color))
        .collect();
    Image {
        width: frame.width,
        height: frame.height,
        pixels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_frames::{ImageSource, Orientation};
    use ostra_geometry::Camera;

    #[test]
    fn depth_ramp_runs_from_near_to_far_and_holes_are_dark() {
        let depths = (0..400)
            .map(|i| if i == 7 { 0.0 } else { 1.0 + i as f32 / 400.0 })
            .collect();
        let drawn = draw_depth(&DepthMap {
            width: 20,
            height: 20,
            depths,
        });
        let [near, far] = drawn.range.unwrap();
        assert!(
            (near - 1.0).abs() < 0.02 && (far - 2.0).abs() < 0.02,
            "{near} to {far}"
        );
        let pixels = &drawn.image.pixels;
        assert_eq!(
            (pixels[7], pixels[0], pixels[399]),
            (UNKNOWN, [68, 1, 84], [253, 231, 37])
        );
        let empty = draw_depth(&DepthMap {
            width: 2,
            height: 1,
            depths: vec![0.0; 2],
        });
        assert_eq!(
            (empty.range, &empty.image.pixels[..]),
            (None, &[UNKNOWN; 2][..])
        );
    }

    #[test]
    fn normals_and_confidence_are_aligned_with_the_image() {
        let made = EstimatedDepth {
            camera: Camera::pinhole(2, 1, [2.0, 2.0], [1.0, 0.5]),
            depth: DepthMap {
                width: 2,
                height: 1,
                depths: vec![1.0, 0.0],
            },
            normals: vec![[0, 0, -127], [0; 3]],
            confidence: vec![255, 9],
        };
        let image = ImageSource::File {
            path: "a.png".into(),
            orientation: Orientation::default(),
        };
        let frame = Frame {
            name: "a".into(),
            width: 4,
            height: 2,
            image,
            depth: None,
            camera: None,
        };
        let normals = draw_normals(&made, &frame).image;
        assert_eq!(
            (normals.at(1, 1), normals.at(2, 0)),
            ([128, 128, 255], UNKNOWN)
        );
        let confidence = draw_confidence(&made, &frame).image;
        assert_eq!(
            (confidence.at(0, 1), confidence.at(3, 1)),
            ([253, 231, 37], UNKNOWN)
        );
    }
}
