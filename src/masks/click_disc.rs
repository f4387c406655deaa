use crate::lab::{lab_of_pixel, squared_difference};
use crate::{Click, Region};
use ostra_frames::Image;

/// Radius of the pixels around a click that obey it, in pixels of an image of [`REFERENCE_PX`].
///
/// A single pixel that changes cannot be seen on the screen.
const RADIUS_PX: f64 = 3.0;
/// Pixels of an image up to which the radius stays the same; above, it grows with the image.
const REFERENCE_PX: f64 = 1_300_000.0;
/// Maximum colour difference from the clicked pixel, ΔE.
const ALIKE_DELTA_E: f32 = 10.0;

/// Makes an answer obey its last click where the segmenter did not.
///
/// The clicked pixel and the pixels around it that look like it change to the side of the click,
/// unless most of them are there already. `taken` pixels and those nearer to a click of the other
/// kind stay. Nothing happens if the last click is not in the image.
pub fn obey(region: &mut Region, clicks: &[Click], taken: Option<&Region>, image: &Image) {
    let Some((click, earlier)) = clicks.split_last() else {
        return;
    };
    debug_assert_eq!((region.width, region.height), (image.width, image.height));
    let Some(clicked) = click.pixel_in(image.width, image.height) else {
        return;
    };
    let disc: Vec<usize> = alike_around(click, clicked, image)
        .into_iter()
        .filter(|&at| !taken.is_some_and(|taken| taken.inside[at]))
        .filter(|&at| !belongs_to_other(at, click, earlier, image))
        .collect();
    let wrong = disc
        .iter()
        .filter(|&&at| region.inside[at] != click.include)
        .count();
    let is_wrong = region.inside[clicked] != click.include;
    if is_wrong || 2 * wrong > disc.len() {
        for at in disc {
            region.inside[at] = click.include;
        }
    }
}

/// Returns the pixels near a click that are connected to it by pixels of its colour.
fn alike_around(click: &Click, clicked: usize, image: &Image) -> Vec<usize> {
    let (width, height) = (image.width as usize, image.height as usize);
    let area = f64::from(image.width) * f64::from(image.height);
    let radius_px = RADIUS_PX * (area / REFERENCE_PX).sqrt().max(1.0);
    let color = lab_of_pixel(image.pixels[clicked]);
    let mut found = vec![clicked];
    let mut next = 0;
    while let Some(&at) = found.get(next) {
        next += 1;
        let (x, y) = (at % width, at / width);
        let around = [
            (x > 0).then(|| at - 1),
            (x + 1 < width).then_some(at + 1),
            (y > 0).then(|| at - width),
            (y + 1 < height).then_some(at + width),
        ];
        for to in around.into_iter().flatten() {
            let is_near = centre(to, image).distance(click.at_px) <= radius_px;
            if is_near
                && !found.contains(&to)
                && squared_difference(lab_of_pixel(image.pixels[to]), color)
                    <= ALIKE_DELTA_E.powi(2)
            {
                found.push(to);
            }
        }
    }
    found
}

fn belongs_to_other(at: usize, click: &Click, earlier: &[Click], image: &Image) -> bool {
    let place = centre(at, image);
    let to_click = place.distance(click.at_px);
    earlier
        .iter()
        .filter(|other| other.include != click.include)
        .any(|other| place.distance(other.at_px) < to_click)
}

fn centre(at: usize, image: &Image) -> glam::DVec2 {
    let width = image.width as usize;
    glam::DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    const SIDE: u32 = 21;

    /// Returns a grey image with a white vertical line of three pixels in the middle.
    fn wire() -> Image {
        let color = |at: u32| {
            if (9..12).contains(&(at % SIDE)) {
                255
            } else {
                60
            }
        };
        Image {
            width: SIDE,
            height: SIDE,
            pixels: (0..SIDE * SIDE).map(|at| [color(at); 3]).collect(),
        }
    }

    fn click(x: f64, y: f64, include: bool) -> Click {
        Click {
            at_px: DVec2::new(x, y),
            include,
        }
    }

    #[test]
    fn ignored_click_changes_alike_pixels_around_it() {
        let mut region = Region::empty(SIDE, SIDE);
        obey(&mut region, &[click(10.5, 10.5, true)], None, &wire());
        assert!(region.at(10, 10) && region.at(9, 9) && region.at(10, 13));
        assert!(
            !region.at(7, 10) && !region.at(10, 14),
            "background, and farther away"
        );
        let all = region.area();
        assert!((15..=21).contains(&all), "{all}");
        let mut whole = Region::empty(SIDE, SIDE).inverted();
        obey(&mut whole, &[click(10.5, 10.5, false)], None, &wire());
        assert_eq!(
            whole.inverted(),
            region,
            "an exclude click removes the same pixels"
        );
    }

    #[test]
    fn obeyed_click_changes_nothing() {
        let mut region = Region::empty(SIDE, SIDE);
        for at in 0..region.inside.len() {
            region.inside[at] = at / 21 < 12;
        }
        let before = region.clone();
        obey(&mut region, &[click(10.5, 10.5, true)], None, &wire());
        assert_eq!(region, before, "only a few pixels of the disc lie outside");
    }

    #[test]
    fn taken_pixels_and_those_of_other_clicks_stay() {
        let mut taken = Region::empty(SIDE, SIDE);
        taken.inside[9 * 21 + 10] = true;
        let clicks = [click(10.5, 12.5, false), click(10.5, 10.5, true)];
        let mut region = Region::empty(SIDE, SIDE);
        obey(&mut region, &clicks, Some(&taken), &wire());
        assert!(region.at(10, 10) && !region.at(10, 9) && !region.at(10, 12));
    }
}
