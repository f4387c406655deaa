use glam::DVec2;

use super::super::heat::{Heat, Sampled};
use super::super::keypoints::PreparedImage;
use ostra_core::image::ImageSize;

/// Returns logits of cells (columns · rows) whose softmax falls off like a Gaussian around a
/// position; nothing elsewhere.
fn logits(columns: usize, rows: usize, peak: DVec2) -> Vec<f32> {
    let mut logits = vec![0.0; 65 * columns * rows];
    for (channel, plane) in logits.chunks_exact_mut(columns * rows).enumerate() {
        for (cell, value) in plane.iter_mut().enumerate() {
            let corner = DVec2::new((cell % columns * 8) as f64, (cell / columns * 8) as f64);
            let at = corner + DVec2::new((channel % 8) as f64 + 0.5, (channel / 8) as f64 + 0.5);
            *value = if channel == 64 {
                0.0
            } else {
                (2.0 - at.distance_squared(peak) / 2.0) as f32
            };
        }
    }
    logits
}

#[test]
fn gaussian_peak_is_found_once_with_subpixel_position() {
    let peak = DVec2::new(12.7, 19.2);
    let heat = Heat::from_logits(&logits(3, 4, peak), 3, 4);
    let peaks = heat.peaks(24, 32, 0.05);
    assert_eq!(peaks, [(12, 19)]);
    assert!(
        heat.refined(12, 19).distance(peak) < 0.02,
        "{}",
        heat.refined(12, 19)
    );
    assert_eq!(heat.peaks(12, 32, 0.05), [], "outside of what is shown");
}

#[test]
fn first_of_equal_neighbours_is_the_peak() {
    let heat = Heat::from_logits(&logits(3, 4, DVec2::new(13.0, 20.0)), 3, 4);
    assert_eq!(heat.peaks(24, 32, 0.05), [(12, 19)]);
}

#[test]
fn values_between_cells_are_interpolated() {
    let (columns, rows) = (4, 3);
    let plane =
        |weight: f32| (0..12).map(move |cell| weight * (cell % 4) as f32 + (cell / 4) as f32);
    let sampled = Sampled::new(
        &plane(1.0).chain(plane(-2.0)).collect::<Vec<_>>(),
        2,
        columns,
        rows,
    );
    let mut read = [0.0; 2];
    sampled.read(DVec2::new(18.0, 9.0), &mut read);
    assert_eq!(read, [1.75 + 0.625, -3.5 + 0.625]);
    let mut corner = [0.0; 2];
    sampled.read(DVec2::new(32.0, 24.0), &mut corner);
    assert_eq!(corner, [5.0, -4.0], "beyond the last centre its own value");
}

#[test]
fn image_is_shrunk_and_its_edges_repeated() {
    let slope: Vec<f32> = (0..100 * 50).map(|at| (at % 100) as f32 / 100.0).collect();
    let size = ImageSize {
        width: 100,
        height: 50,
    };
    let kept = PreparedImage::new(&slope, size, 100, 32);
    assert_eq!(
        (
            kept.width,
            kept.height,
            kept.unpadded.width,
            kept.unpadded.height
        ),
        (128, 64, 100, 50)
    );
    assert_eq!(
        (kept.grey[49 * 128 + 7], kept.grey[63 * 128 + 127]),
        (0.07, 0.99)
    );
    assert_eq!(kept.original_from_here, DVec2::ONE);
    let half = PreparedImage::new(&slope, size, 50, 32);
    assert_eq!(
        (
            half.width,
            half.height,
            half.unpadded.width,
            half.unpadded.height
        ),
        (64, 32, 50, 25)
    );
    assert_eq!(half.original_from_here, DVec2::splat(2.0));
    assert!(
        (half.grey[20] - 0.405).abs() < 1e-3,
        "columns 40 and 41: {}",
        half.grey[20]
    );
}
