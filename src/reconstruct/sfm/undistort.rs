use glam::DVec2;
use rayon::prelude::*;

use ostra_core::image::bilinear;
use ostra_frames::Image;
use ostra_geometry::{Camera, Distortion};
use ostra_masks::{LabelId, LabelMask};

/// Smallest share of its focal length at which a wide lens is drawn; the parts further out are cut off.
const SMALLEST_SCALE: f64 = 0.2;
/// Pixels of a row between which positions are interpolated: less than 0.02 px off even for strong lenses.
const RUN: usize = 8;
/// Border positions sampled per side.
const BORDER_STEPS: u32 = 256;

/// Returns the pinhole camera that shows as much as possible of an image without empty pixels.
///
/// It has the size, centre and pixel shape of `camera`, and every one of its pixels is seen by
/// `camera`.
#[must_use]
pub fn undistorted_camera(camera: &Camera) -> Camera {
    let plain = Camera {
        distortion: Distortion::None,
        ..*camera
    };
    if camera.distortion == Distortion::None {
        return plain;
    }
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    // Position of the image's edges without distortion, in pixels of the pinhole camera from the
    // principal point.
    let inner = |from: DVec2, to: DVec2, outwards: DVec2| {
        (0..=BORDER_STEPS)
            .map(|step| from.lerp(to, f64::from(step) / f64::from(BORDER_STEPS)))
            .map(|at_px| (camera.unproject(at_px) * plain.focal_px).dot(outwards))
            .filter(|reach| reach.is_finite())
            .fold(f64::INFINITY, f64::min)
    };
    let (right_top, left_bottom) = (DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y));
    let after = size - camera.principal_px;
    let sides = [
        camera.principal_px.x / inner(DVec2::ZERO, left_bottom, DVec2::NEG_X),
        camera.principal_px.y / inner(DVec2::ZERO, right_top, DVec2::NEG_Y),
        after.x / inner(right_top, size, DVec2::X),
        after.y / inner(left_bottom, size, DVec2::Y),
    ];
    let scale = sides.into_iter().fold(SMALLEST_SCALE, f64::max);
    Camera {
        focal_px: plain.focal_px * scale,
        ..plain
    }
}

/// Converts an image of camera `from` to camera `to` at the same position, interpolating between four pixels.
///
/// Pixels that `from` does not see are black. `image` has the size of `from`.
#[must_use]
pub fn undistort_image(image: &Image, from: &Camera, to: &Camera) -> Image {
    let mut pixels = vec![[0; 3]; to.width as usize * to.height as usize];
    for_each_source(&mut pixels, from, to, |at_px| between(image, at_px));
    Image {
        width: to.width,
        height: to.height,
        pixels,
    }
}

/// Converts a mask of camera `from` to camera `to` at the same position.
///
/// Each pixel takes the id of the pixel that it hits, never a mixture; pixels that `from` does not
/// see get no label. `mask` has the size of `from`.
#[must_use]
pub fn undistort_mask(mask: &LabelMask, from: &Camera, to: &Camera) -> LabelMask {
    let mut ids = vec![LabelId::NONE; to.width as usize * to.height as usize];
    for_each_source(&mut ids, from, to, |at_px| {
        mask.at(at_px.x as u32, at_px.y as u32)
    });
    LabelMask {
        width: to.width,
        height: to.height,
        ids,
    }
}

/// Sets every pixel of `to` by its position in `from`, in pixels, if it has one.
///
/// The cameras are at the same position.
pub fn for_each_source<T: Send>(
    pixels: &mut [T],
    from: &Camera,
    to: &Camera,
    value: impl Fn(DVec2) -> T + Sync,
) {
    let source = |column: usize, row: usize| {
        let at_px = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
        from.project(to.unproject(at_px).extend(1.0))
    };
    pixels
        .par_chunks_mut(to.width.max(1) as usize)
        .enumerate()
        .for_each(|(row, pixels)| {
            let mut start = source(0, row);
            for (run, pixels) in pixels.chunks_mut(RUN).enumerate() {
                let end = source((run + 1) * RUN, row);
                for (at, pixel) in pixels.iter_mut().enumerate() {
                    let at_px = match (start, end) {
                        (Some(start), Some(end)) => Some(start.lerp(end, at as f64 / RUN as f64)),
                        _ => source(run * RUN + at, row),
                    };
                    if let Some(at_px) = at_px.filter(|at_px| from.contains(*at_px)) {
                        *pixel = value(at_px);
                    }
                }
                start = end;
            }
        });
}

/// Returns the colour at a position inside the image, from the four pixel centres around it.
fn between(image: &Image, at_px: DVec2) -> [u8; 3] {
    let last = DVec2::new(f64::from(image.width) - 1.0, f64::from(image.height) - 1.0);
    let at = (at_px - 0.5).clamp(DVec2::ZERO, last);
    let (low, high) = (at.floor().as_uvec2(), at.ceil().as_uvec2());
    let share = at.fract();
    let corners = [
        (low.x, low.y),
        (high.x, low.y),
        (low.x, high.y),
        (high.x, high.y),
    ]
    .map(|(x, y)| image.at(x, y));
    std::array::from_fn(|channel| {
        let corners = corners.map(|corner| f64::from(corner[channel]));
        bilinear(corners, share.to_array()).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns strong barrel, pincushion, off-centre and fisheye lenses.
    fn lenses() -> [Camera; 4] {
        let base = Camera::pinhole(160, 120, [110.0, 112.0], [83.0, 57.5]);
        [
            Camera {
                distortion: Distortion::Radial { k: [-0.25, 0.03] },
                ..base
            },
            Camera {
                distortion: Distortion::Radial { k: [0.2, 0.05] },
                ..base
            },
            Camera {
                distortion: Distortion::OpenCv {
                    k: [-0.2, 0.02],
                    p: [0.01, -0.02],
                },
                ..base
            },
            Camera {
                distortion: Distortion::OpenCvFisheye {
                    k: [0.05, 0.01, 0.0, 0.0],
                },
                ..base
            },
        ]
    }

    /// Renders a wall whose colour depends on the position on the plane z = 1.
    fn seen<T>(camera: &Camera, wall: impl Fn(DVec2) -> T) -> Vec<T> {
        (0..camera.width * camera.height)
            .map(|at| {
                DVec2::new(
                    f64::from(at % camera.width) + 0.5,
                    f64::from(at / camera.width) + 0.5,
                )
            })
            .map(|at_px| wall(camera.unproject(at_px)))
            .collect()
    }

    /// Returns soft stripes that are straight on the wall.
    fn stripes(at: DVec2) -> [u8; 3] {
        [at.x + 0.3 * at.y, at.y, at.y - at.x]
            .map(|along| (127.5 + 100.0 * (12.0 * along).sin()).round() as u8)
    }

    #[test]
    fn straight_lines_stay_straight_after_undistortion() {
        for from in lenses() {
            let to = undistorted_camera(&from);
            let image = Image {
                width: from.width,
                height: from.height,
                pixels: seen(&from, stripes),
            };
            let straight = undistort_image(&image, &from, &to);
            let expected = seen(&to, stripes);
            let off = |a: &[u8; 3], b: &[u8; 3]| (0..3).map(|at| a[at].abs_diff(b[at])).max();
            let worst = straight
                .pixels
                .iter()
                .zip(&expected)
                .filter_map(|(a, b)| off(a, b))
                .max();
            assert!(worst < Some(8), "{worst:?} with {from:?}");
            let unchanged = image
                .pixels
                .iter()
                .zip(&expected)
                .filter_map(|(a, b)| off(a, b))
                .max();
            assert!(
                unchanged > Some(60),
                "the lens distorts too little to test anything"
            );
        }
    }

    #[test]
    fn undistorted_camera_sees_the_largest_view_without_empty_pixels() {
        for from in lenses() {
            let to = undistorted_camera(&from);
            assert_eq!(to.distortion, Distortion::None);
            let white = Image {
                width: 160,
                height: 120,
                pixels: vec![[255; 3]; 160 * 120],
            };
            assert!(
                undistort_image(&white, &from, &to)
                    .pixels
                    .iter()
                    .all(|&pixel| pixel == [255; 3]),
                "{from:?}"
            );
            let wider = Camera {
                focal_px: 0.98 * to.focal_px,
                ..to
            };
            assert!(
                undistort_image(&white, &from, &wider)
                    .pixels
                    .contains(&[0; 3]),
                "{from:?}"
            );
        }
    }

    #[test]
    fn interpolated_positions_are_accurate() {
        for lens in lenses() {
            // At the size that lenses are used at: the smaller an image, the more a lens bends
            // within one run.
            let from = Camera {
                width: 1280,
                height: 960,
                focal_px: 8.0 * lens.focal_px,
                principal_px: 8.0 * lens.principal_px,
                ..lens
            };
            let to = undistorted_camera(&from);
            let mut sources = vec![DVec2::NAN; 1280 * 960];
            for_each_source(&mut sources, &from, &to, |at_px| at_px);
            let worst = (0..1280 * 960)
                .map(|at| DVec2::new(f64::from(at % 1280) + 0.5, f64::from(at / 1280) + 0.5))
                .zip(&sources)
                .map(|(at_px, found)| {
                    from.project(to.unproject(at_px).extend(1.0))
                        .unwrap()
                        .distance(*found)
                })
                .fold(0.0, f64::max);
            assert!(worst < 0.02, "{worst} px with {from:?}");
        }
    }

    #[test]
    fn label_ids_are_never_mixed() {
        // Neighbours 3 and 40: any id between them would be a mixture.
        let part = |at: DVec2| {
            LabelId(if (9.0 * at.x).sin() * (9.0 * at.y).sin() > 0.0 {
                40
            } else {
                3
            })
        };
        for from in lenses() {
            let to = undistorted_camera(&from);
            let mask = LabelMask {
                width: from.width,
                height: from.height,
                ids: seen(&from, part),
            };
            let straight = undistort_mask(&mask, &from, &to);
            assert!(straight.ids.iter().all(|id| [3, 40].contains(&id.0)));
            let wrong = straight
                .ids
                .iter()
                .zip(seen(&to, part))
                .filter(|(a, b)| *a != b)
                .count();
            assert!(
                wrong < straight.ids.len() / 20,
                "{wrong} wrong with {from:?}"
            );
        }
    }

    #[test]
    fn pinhole_camera_is_unchanged() {
        let camera = Camera::pinhole(4, 3, [5.0, 5.0], [2.1, 1.4]);
        assert_eq!(undistorted_camera(&camera), camera);
        let image = Image {
            width: 4,
            height: 3,
            pixels: (0..12).map(|at| [at, 2 * at, 255 - at]).collect(),
        };
        assert_eq!(undistort_image(&image, &camera, &camera), image);
    }
}
