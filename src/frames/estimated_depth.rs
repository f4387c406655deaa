use std::io::{BufReader, Cursor, Read, Seek};
use std::path::Path;

use glam::DVec2;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::{Gray8, Gray32Float, RGB8};
use tiff::tags::Tag;
use tiff::{TiffError, TiffResult};

use super::{DepthMap, Frame, FrameError};
use ostra_core::disk;
use ostra_core::image::bilinear;
use ostra_geometry::Camera;

/// A reconstructed depth map with normals and confidence, often smaller than the frame's image.
///
/// On disk it is a TIFF of three pages: depth as 32-bit floats, normals as RGB (0 to 255 for −1 to
/// 1; black = unknown), and confidence as 8-bit grey. The description of the first page is the
/// camera as JSON.
///
/// The map keeps its own pinhole camera because stereo works on reduced, undistorted images. The
/// depth stays as computed, and is converted to the frame's camera once, on loading.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedDepth {
    /// Camera of the map, without lens distortion, at the pose of the frame's camera.
    pub camera: Camera,
    /// Depth in world units; 0 = unknown.
    pub depth: DepthMap,
    /// Unit normals in the camera's axes, towards the camera, times 127; zero if unknown.
    pub normals: Vec<[i8; 3]>,
    /// Confidence, 0–255 for 0–1.
    pub confidence: Vec<u8>,
}

/// Maximum relative difference of depth on one surface; nothing is interpolated between surfaces.
const SAME_SURFACE: f32 = 0.02;

impl EstimatedDepth {
    /// Reads a file written by [`Self::encode`].
    ///
    /// # Errors
    ///
    /// [`FrameError`] if it is missing or damaged.
    pub fn read(path: &Path) -> Result<Self, FrameError> {
        let file = disk::open_regular(path).map_err(|reason| FrameError::io(path, reason))?;
        let bytes = file
            .metadata()
            .map_err(|reason| FrameError::io(path, reason))?
            .len();
        decode(BufReader::new(file), bytes).map_err(|error| FrameError::Invalid {
            path: path.into(),
            what: format!("the depth map is damaged ({error}); reconstruct again"),
        })
    }

    /// Returns the bytes of the file.
    ///
    /// # Errors
    ///
    /// If the sizes do not agree or an image of this size cannot be written.
    pub fn encode(&self) -> TiffResult<Vec<u8>> {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes)?;
        let (width, height) = (self.depth.width, self.depth.height);
        let camera = serde_json::to_string(&self.camera).map_err(std::io::Error::from)?;
        let mut page = encoder.new_image::<Gray32Float>(width, height)?;
        page.encoder()
            .write_tag(Tag::ImageDescription, camera.as_str())?;
        page.write_data(&self.depth.depths)?;
        let normals: Vec<u8> = self
            .normals
            .iter()
            .flat_map(|&normal| packed(normal))
            .collect();
        encoder.write_image::<RGB8>(width, height, &normals)?;
        encoder.write_image::<Gray8>(width, height, &self.confidence)?;
        Ok(bytes.into_inner())
    }

    /// Returns the depth of every pixel of the frame's image, through its lens, times `scale`.
    ///
    /// Depth is interpolated between neighbours on one surface.
    #[must_use]
    pub fn seen_by(&self, frame: &Frame, scale: f64) -> DepthMap {
        let depth =
            |at_px: Option<DVec2>| scale as f32 * at_px.map_or(0.0, |at_px| self.between(at_px));
        let depths = self.positions_seen_by(frame).map(depth).collect();
        DepthMap {
            width: frame.width,
            height: frame.height,
            depths,
        }
    }

    /// Returns the pixel of the map at every pixel of the frame's image, row by row.
    ///
    /// `None` outside the map.
    pub fn pixels_seen_by(&self, frame: &Frame) -> impl Iterator<Item = Option<usize>> {
        let pixel = |at_px: DVec2| {
            let inside = self.camera.contains(at_px);
            inside.then_some(at_px.y as usize * self.depth.width as usize + at_px.x as usize)
        };
        self.positions_seen_by(frame)
            .map(move |at_px| at_px.and_then(pixel))
    }

    /// Returns the position in the map of each pixel of the frame's image, in pixels.
    fn positions_seen_by(&self, frame: &Frame) -> impl Iterator<Item = Option<DVec2>> {
        let (width, height) = (frame.width, frame.height);
        let intrinsics = frame.camera.map(|camera| camera.intrinsics);
        let share = DVec2::new(f64::from(self.depth.width), f64::from(self.depth.height))
            / DVec2::new(f64::from(width), f64::from(height));
        let position = move |x: u32, y: u32| {
            let at_px = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            intrinsics.map_or(Some(at_px * share), |intrinsics| {
                self.camera.project(intrinsics.unproject(at_px).extend(1.0))
            })
        };
        (0..height).flat_map(move |y| (0..width).map(move |x| position(x, y)))
    }

    /// Returns the depth at a position in pixels; 0 outside the map and where it is unknown.
    fn between(&self, at_px: DVec2) -> f32 {
        if !self.camera.contains(at_px) {
            return 0.0;
        }
        let (width, height) = (f64::from(self.depth.width), f64::from(self.depth.height));
        let nearest = self.depth.at(at_px.x as u32, at_px.y as u32);
        let corner = (at_px - 0.5).clamp(DVec2::ZERO, DVec2::new(width - 1.0, height - 1.0));
        let (left, top) = (corner.x as u32, corner.y as u32);
        let (right, low) = (
            (left + 1).min(self.depth.width - 1),
            (top + 1).min(self.depth.height - 1),
        );
        let around = [(left, top), (right, top), (left, low), (right, low)]
            .map(|(x, y)| self.depth.at(x, y));
        if nearest == 0.0
            || around
                .iter()
                .any(|&depth| (depth - nearest).abs() > SAME_SURFACE * nearest)
        {
            return nearest;
        }
        let (over, down) = (corner.x.fract() as f32, corner.y.fract() as f32);
        bilinear(around, [over, down])
    }
}

/// Returns a normal as colour: 128 stands for 0, black for no normal.
fn packed(normal: [i8; 3]) -> [u8; 3] {
    if normal == [0; 3] {
        [0; 3]
    } else {
        normal.map(|value| (i16::from(value) + 128) as u8)
    }
}

fn unpacked(pixel: &[u8]) -> [i8; 3] {
    if pixel == [0; 3] {
        [0; 3]
    } else {
        [0, 1, 2].map(|i| (i16::from(pixel[i]) - 128) as i8)
    }
}

/// Reads a file of `bytes` bytes.
///
/// The pixels are not compressed, so a header that claims more is damaged.
fn decode(reader: impl Read + Seek, bytes: u64) -> TiffResult<EstimatedDepth> {
    let mut decoder = Decoder::new(reader)?;
    let wrong = || {
        TiffError::from(std::io::Error::other(
            "it is not a depth map with normals and confidences",
        ))
    };
    let (width, height) = decoder.dimensions()?;
    if u64::from(width) * u64::from(height) > bytes / size_of::<f32>() as u64 {
        return Err(std::io::Error::other("it is cut off").into());
    }
    let camera = decoder.get_tag_ascii_string(Tag::ImageDescription)?;
    let camera: Camera = serde_json::from_str(&camera).map_err(std::io::Error::from)?;
    let DecodingResult::F32(depths) = decoder.read_image()? else {
        return Err(wrong());
    };
    decoder.next_image()?;
    let DecodingResult::U8(normals) = decoder.read_image()? else {
        return Err(wrong());
    };
    decoder.next_image()?;
    let DecodingResult::U8(confidence) = decoder.read_image()? else {
        return Err(wrong());
    };
    let pixels = width as usize * height as usize;
    let normals: Vec<[i8; 3]> = normals.chunks_exact(3).map(unpacked).collect();
    let fits = (depths.len(), normals.len(), confidence.len()) == (pixels, pixels, pixels)
        && (camera.width, camera.height) == (width, height);
    if !fits {
        return Err(wrong());
    }
    Ok(EstimatedDepth {
        camera,
        depth: DepthMap {
            width,
            height,
            depths,
        },
        normals,
        confidence,
    })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::{FrameCamera, FrameStore, ImageSource, Orientation};
    use ostra_geometry::{Distortion, Pose};

    fn slope() -> EstimatedDepth {
        let camera = Camera::pinhole(8, 6, [10.0, 10.0], [4.0, 3.0]);
        // Depth grows to the right; the last two columns lie on another surface, and a corner is
        // unknown.
        let at = |i: u32| match i % 8 {
            _ if i == 0 => 0.0,
            x if x < 6 => 2.0 + 0.01 * x as f32,
            _ => 5.0,
        };
        let normals = (0..48)
            .map(|i| {
                if i == 0 {
                    [0; 3]
                } else {
                    [76, i as i8 - 24, -102]
                }
            })
            .collect();
        let depth = DepthMap {
            width: 8,
            height: 6,
            depths: (0..48).map(at).collect(),
        };
        EstimatedDepth {
            camera,
            depth,
            normals,
            confidence: (0..48).collect(),
        }
    }

    fn frame(camera: Option<Camera>, made: &str) -> Frame {
        Frame {
            name: "a.png".into(),
            width: 16,
            height: 12,
            image: ImageSource::File {
                path: "a.png".into(),
                orientation: Orientation::default(),
            },
            depth: Some(crate::DepthSource::Estimated {
                made: PathBuf::from(made),
                scale: 1.0,
            }),
            camera: camera.map(|intrinsics| FrameCamera::given(intrinsics, Some(Pose::default()))),
        }
    }

    #[test]
    fn file_is_read_as_written_and_broken_ones_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tiff");
        let made = slope();
        let bytes = made.encode().unwrap();
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(EstimatedDepth::read(&path).unwrap(), made);
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(
            EstimatedDepth::read(&path)
                .unwrap_err()
                .to_string()
                .contains("reconstruct again")
        );
        let lacking = EstimatedDepth {
            camera: Camera {
                width: 9,
                ..made.camera
            },
            ..made
        };
        std::fs::write(&path, lacking.encode().unwrap()).unwrap();
        assert!(EstimatedDepth::read(&path).is_err());
    }

    #[test]
    fn store_loads_the_map_from_its_home_at_image_size() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.tiff"), slope().encode().unwrap()).unwrap();
        let store = FrameStore::at_home(1 << 20, folder.path().into());
        let seen = store.depth(&frame(None, "a.tiff")).unwrap().unwrap();
        assert_eq!((seen.width, seen.height), (16, 12));
        assert!(
            (seen.at(4, 5) - 2.0175).abs() < 1e-5,
            "between columns 1 and 2: {}",
            seen.at(4, 5)
        );
        assert_eq!(
            (seen.at(11, 5), seen.at(12, 5)),
            (2.05, 5.0),
            "not between surfaces"
        );
        assert_eq!(seen.at(1, 1), 0.0);
        let larger = Some(crate::DepthSource::Estimated {
            made: "a.tiff".into(),
            scale: 2.0,
        });
        let larger = store
            .depth(&Frame {
                depth: larger,
                ..frame(None, "a.tiff")
            })
            .unwrap()
            .unwrap();
        assert_eq!(larger.at(12, 5), 10.0);
        assert!(
            FrameStore::new(1 << 20)
                .depth(&frame(None, "a.tiff"))
                .is_err()
        );
    }

    #[test]
    fn lens_distorts_the_image_but_not_the_depth_map() {
        let lens = Camera {
            distortion: Distortion::Radial { k: [-0.3, 0.0] },
            ..Camera::pinhole(16, 12, [20.0, 20.0], [8.0, 6.0])
        };
        let (made, frame) = (slope(), frame(Some(lens), "a.tiff"));
        let seen = made.seen_by(&frame, 1.0);
        let at_px = DVec2::new(2.5, 6.5);
        let here = made
            .camera
            .project(lens.unproject(at_px).extend(1.0))
            .unwrap();
        assert!(
            (here.x - at_px.x / 2.0).abs() > 0.02,
            "the lens matters here"
        );
        assert!((f64::from(seen.at(2, 6)) - (2.0 + 0.01 * (here.x - 0.5))).abs() < 1e-5);
    }
}
