use super::super::blur::{Kernel, blur, double, halve};
use super::super::orientation::turn_of;
use super::super::rows::{Rows, SpareBuffers};
use std::f32::consts::TAU;

/// Returns a plane that rises along x and y, as an image of odd size.
fn ramp(width: usize, height: usize) -> Rows {
    let grey: Vec<f32> = (0..width * height)
        .map(|k| 0.01 * (k % width) as f32 + 0.002 * (k / width) as f32)
        .collect();
    Rows::from_grey(&grey, width, height, &SpareBuffers::default())
}

#[test]
fn blur_keeps_a_plane() {
    let source = ramp(301, 57);
    let mut out = Rows::new(301, 57, 57, &SpareBuffers::default());
    blur(&source, &Kernel::gaussian(2.3), &mut out, 0, 57);
    for (y, x) in [(28, 20), (28, 150), (28, 255), (28, 256), (20, 280)] {
        assert!((out.row(y)[x] - source.row(y)[x]).abs() < 1e-5, "{x} {y}");
    }
}

#[test]
fn doubled_and_halved_samples_keep_their_position() {
    let source = ramp(201, 61);
    let mut doubled = Rows::new(402, 122, 122, &SpareBuffers::default());
    double(&source, &Kernel::doubling(1.4), &mut doubled, 0, 122);
    let halved = halve(&source, &Kernel::gaussian(2.0), &SpareBuffers::default());
    assert_eq!((halved.width, halved.height), (101, 31));
    let plane = |x: f32, y: f32| 0.01 * x + 0.002 * y;
    for (y, x) in [(60, 80), (61, 80), (60, 81), (61, 255), (61, 256)] {
        assert!(
            (doubled.row(y)[x] - plane(0.5 * x as f32, 0.5 * y as f32)).abs() < 1e-5,
            "{x} {y}"
        );
    }
    for (y, x) in [(15, 40), (14, 50)] {
        assert!(
            (halved.row(y)[x] - plane(2.0 * x as f32, 2.0 * y as f32)).abs() < 1e-5,
            "{x} {y}"
        );
    }
}

#[test]
fn directions_are_accurate() {
    for k in 0..720 {
        let angle = (k as f32 + 0.25) / 720.0 * TAU;
        let turn = turn_of(3.0 * angle.cos(), 3.0 * angle.sin());
        assert!((turn - angle / TAU).abs() < 5e-6, "{angle}");
    }
    assert!(turn_of(0.0, 0.0).is_finite());
}
