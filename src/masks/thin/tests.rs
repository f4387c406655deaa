use glam::DVec2;

use super::{follow, trace};
use crate::Region;
use crate::outline::distance_to_segment;
use ostra_frames::Image;

const GREY: [f64; 3] = [128.0, 128.0, 128.0];
const GREEN: [f64; 3] = [60.0, 140.0, 50.0];

/// A line with a width and a colour.
struct Drawn {
    points: Vec<DVec2>,
    width_px: f64,
    color: [f64; 3],
}

impl Drawn {
    fn distance(&self, at: DVec2) -> f64 {
        self.points
            .windows(2)
            .map(|ends| distance_to_segment(at, ends[0], ends[1]))
            .fold(f64::INFINITY, f64::min)
    }

    /// Returns the pixels whose centres the line covers.
    fn region(&self) -> Region {
        let center = |at: usize| DVec2::new((at % 200) as f64 + 0.5, (at / 200) as f64 + 0.5);
        let inside = (0..200 * 150)
            .map(|at| self.distance(center(at)) <= self.width_px / 2.0)
            .collect();
        Region {
            width: 200,
            height: 150,
            inside,
        }
    }
}

/// Renders an image of 200 × 150 pixels.
///
/// Edges are soft (each pixel is the mean of 16 samples), and there is a little noise.
fn image(background: [f64; 3], lines: &[Drawn]) -> Image {
    let pixel = |at: usize| {
        let corner = DVec2::new((at % 200) as f64, (at / 200) as f64);
        let mut color = background;
        for line in lines {
            let sample =
                |k: usize| corner + (DVec2::new((k % 4) as f64, (k / 4) as f64) + 0.5) / 4.0;
            let covered = (0..16)
                .filter(|&k| line.distance(sample(k)) <= line.width_px / 2.0)
                .count() as f64
                / 16.0;
            color = [0, 1, 2].map(|k| color[k] + (line.color[k] - color[k]) * covered);
        }
        let noise = ((at * 2_654_435_761) >> 9) % 7;
        color.map(|value| (value + noise as f64 - 3.0).round() as u8)
    };
    Image {
        width: 200,
        height: 150,
        pixels: (0..200 * 150).map(pixel).collect(),
    }
}

fn line(points: &[(f64, f64)], width_px: f64, color: [f64; 3]) -> Drawn {
    Drawn {
        points: points.iter().map(|&(x, y)| DVec2::new(x, y)).collect(),
        width_px,
        color,
    }
}

/// Slightly more than a quarter of a circle, from the lower left to the upper right.
fn arc(width_px: f64) -> Drawn {
    let at = |k: i32| {
        let angle = std::f64::consts::PI * (1.0 - f64::from(k) / 40.0);
        (150.0 + 120.0 * angle.cos(), 135.0 - 115.0 * angle.sin())
    };
    line(&(0..=24).map(at).collect::<Vec<_>>(), width_px, GREEN)
}

#[test]
fn widths_are_accurate_to_a_third_of_a_pixel() {
    for width_px in [1.5, 2.0, 3.0, 4.5, 7.0, 11.0, 16.0] {
        let drawn = line(&[(20.0, 31.0), (180.0, 120.0)], width_px, GREEN);
        let found = trace(
            &image(GREY, &[drawn]),
            &[DVec2::new(40.0, 42.1), DVec2::new(160.0, 108.9)],
        )
        .unwrap();
        let length = DVec2::new(120.0, 66.8).length();
        let measured = found.area() as f64 / length;
        println!("width {width_px}: {measured:.2}");
        assert!(
            (measured - width_px).abs() < 0.3,
            "{measured:.2} in place of {width_px}"
        );
    }
}

#[test]
fn curve_is_followed_from_three_points() {
    for width_px in [2.0, 5.0, 9.0] {
        let drawn = arc(width_px);
        let points = [drawn.points[0], drawn.points[12], drawn.points[24]];
        let truth = drawn.region();
        let iou = trace(&image(GREY, &[drawn]), &points).unwrap().iou(&truth);
        println!("curve of width {width_px}: IoU {iou:.3}");
        assert!(iou > 0.9, "width {width_px}: {iou:.3}");
    }
}

#[test]
fn any_difference_of_colour_makes_a_line() {
    let colors = [
        ("brighter", [205.0; 3]),
        ("darker", [60.0; 3]),
        ("another hue", [165.0, 110.0, 128.0]),
    ];
    for (name, color) in colors {
        let drawn = Drawn { color, ..arc(4.0) };
        let (points, truth) = ([drawn.points[0], drawn.points[24]], drawn.region());
        let iou = trace(&image(GREY, &[drawn]), &points).unwrap().iou(&truth);
        assert!(iou > 0.75, "{name}: {iou:.3}");
    }
}

#[test]
fn crossing_line_is_not_followed() {
    for color in [GREEN, [200.0, 60.0, 40.0]] {
        let drawn = line(&[(10.0, 75.0), (190.0, 85.0)], 5.0, GREEN);
        let truth = drawn.region();
        let crossing = line(&[(80.0, 5.0), (120.0, 145.0)], 6.0, color);
        let far = Drawn {
            width_px: 9.0,
            ..line(&[(10.0, 75.0), (190.0, 85.0)], 5.0, GREEN)
        }
        .region();
        let points = [DVec2::new(12.0, 75.1), DVec2::new(188.0, 84.9)];
        let found = trace(&image(GREY, &[crossing, drawn]), &points).unwrap();
        let mut outside = found.clone();
        outside.subtract(&far);
        assert!(found.iou(&truth) > 0.8, "IoU {:.3}", found.iou(&truth));
        assert!(
            outside.area() < 12,
            "{} pixels of the other line",
            outside.area()
        );
    }
}

#[test]
fn border_of_a_large_object_is_not_a_line() {
    let wall = line(&[(0.0, 20.0), (200.0, 20.0)], 60.0, [90.0, 100.0, 200.0]);
    let drawn = line(&[(10.0, 68.0), (100.0, 60.0), (190.0, 68.0)], 3.0, GREEN);
    let truth = drawn.region();
    let points = [drawn.points[0], drawn.points[2]];
    let iou = trace(&image(GREY, &[wall, drawn]), &points)
        .unwrap()
        .iou(&truth);
    assert!(iou > 0.75, "{iou:.3}");
}

#[test]
fn invalid_points_are_rejected_with_a_hint() {
    let image = image(GREY, &[]);
    let refused = |points: &[(f64, f64)]| {
        let points: Vec<DVec2> = points.iter().map(|&(x, y)| DVec2::new(x, y)).collect();
        trace(&image, &points).unwrap_err().to_string()
    };
    for one in [&[][..], &[(5.0, 5.0)], &[(5.0, 5.0), (5.3, 5.0)]] {
        assert!(
            refused(one).contains("two different points"),
            "{}",
            refused(one)
        );
    }
    assert!(refused(&[(5.0, 5.0), (201.0, 5.0)]).contains("outside the image"));
    assert!(refused(&[(5.0, 5.0), (f64::NAN, 5.0)]).contains("outside the image"));
    let whole = trace(&image, &[DVec2::ZERO, DVec2::new(200.0, 150.0)]).unwrap();
    assert!(
        whole.area() >= 150,
        "an image without lines is crossed all the same"
    );
}

/// Background of a few large patches of other colours.
fn patches() -> Vec<Drawn> {
    vec![
        line(&[(0.0, 20.0), (200.0, 40.0)], 70.0, [150.0, 120.0, 110.0]),
        line(&[(170.0, 60.0), (150.0, 150.0)], 60.0, [90.0, 110.0, 190.0]),
    ]
}

/// Returns the pixels that one click finds.
fn followed(image: &Image, at_px: DVec2) -> Option<Region> {
    let ribbon = follow(image, at_px)?;
    Some(ribbon.region(image.width, image.height, 1).unwrap())
}

#[test]
fn one_click_anywhere_finds_a_whole_curve() {
    for width_px in [2.5, 5.0, 8.0] {
        let drawn = arc(width_px);
        let (clicks, truth) = ([3, 12, 21].map(|at| drawn.points[at]), drawn.region());
        let scene: Vec<Drawn> = patches().into_iter().chain([drawn]).collect();
        let image = image(GREY, &scene);
        for at_px in clicks {
            let iou = followed(&image, at_px).map_or(0.0, |found| found.iou(&truth));
            println!("width {width_px}, click at {at_px}: IoU {iou:.3}");
            assert!(iou > 0.8, "width {width_px}, {at_px}: {iou:.3}");
        }
    }
}

#[test]
fn what_crosses_or_carries_the_structure_is_not_followed() {
    let leaf = || {
        line(
            &[(60.0, 110.0), (75.0, 80.0), (100.0, 60.0), (130.0, 52.0)],
            4.0,
            GREEN,
        )
    };
    let truth = leaf().region();
    let stem = line(&[(60.0, 5.0), (60.0, 145.0)], 5.0, GREEN);
    let wire = line(&[(90.0, 20.0), (125.0, 140.0)], 3.0, [200.0, 60.0, 40.0]);
    for (name, others) in [("stem", vec![stem]), ("wire", vec![wire])] {
        let scene: Vec<Drawn> = others.into_iter().chain([leaf()]).collect();
        let found = followed(&image(GREY, &scene), DVec2::new(112.0, 56.8));
        let iou = found.map_or(0.0, |found| found.iou(&truth));
        assert!(iou > 0.7, "{name}: {iou:.3}");
    }
}

#[test]
fn only_slender_structures_are_found() {
    let thick = line(&[(20.0, 75.0), (180.0, 75.0)], 40.0, GREEN);
    let short = line(&[(80.0, 75.0), (120.0, 75.0)], 8.0, GREEN);
    let faint = line(&[(10.0, 75.0), (190.0, 75.0)], 4.0, [136.0, 128.0, 124.0]);
    for (name, drawn) in [("thick", thick), ("short", short), ("faint", faint)] {
        let image = image(GREY, &[drawn]);
        assert!(follow(&image, DVec2::new(100.0, 75.0)).is_none(), "{name}");
    }
    let empty = image(GREY, &[]);
    for at_px in [
        DVec2::ZERO,
        DVec2::new(100.0, 75.0),
        DVec2::new(199.9, 149.9),
    ] {
        assert!(follow(&empty, at_px).is_none());
    }
}
