//! The robot user: places clicks where a person would, by looking at the truth.

use glam::DVec2;

use super::{Click, Region};

/// The next click of the robot user: the deepest point (farthest from its border, the picture's border included) of
/// the largest 4-connected component of pixels where `current` differs from `truth`; include where the object is
/// missed, exclude where too much was taken. `None` when both are equal.
///
/// With an empty `current` this is the deepest point of the object's largest part.
///
/// # Panics
/// When the two regions differ in size.
#[must_use]
pub fn next_click(truth: &Region, current: &Region) -> Option<Click> {
    assert!(truth.width == current.width && truth.height == current.height, "truth and answer are of one frame");
    let component = largest_error(truth, current)?;
    let at = deepest(&component, truth.width as usize);
    let (x, y) = (at % truth.width as usize, at / truth.width as usize);
    Some(Click { at_px: DVec2::new(x as f64 + 0.5, y as f64 + 0.5), include: truth.inside[at] })
}

/// Pixels of the largest error component in scan order; of equally large ones the first met.
fn largest_error(truth: &Region, current: &Region) -> Option<Vec<usize>> {
    let width = truth.width as usize;
    let mut open: Vec<bool> = truth.inside.iter().zip(&current.inside).map(|(a, b)| a != b).collect();
    let mut largest: Vec<usize> = Vec::new();
    for start in 0..open.len() {
        if !open[start] {
            continue;
        }
        open[start] = false;
        let mut pixels = vec![start];
        let mut next = 0;
        while let Some(&at) = pixels.get(next) {
            next += 1;
            for neighbour in neighbours(at, width, open.len()) {
                if open[neighbour] && truth.inside[neighbour] == truth.inside[start] {
                    open[neighbour] = false;
                    pixels.push(neighbour);
                }
            }
        }
        if pixels.len() > largest.len() {
            largest = pixels;
        }
    }
    largest.sort_unstable();
    (!largest.is_empty()).then_some(largest)
}

fn neighbours(at: usize, width: usize, count: usize) -> impl Iterator<Item = usize> {
    let x = at % width;
    [
        (x > 0).then(|| at - 1),
        (x + 1 < width).then(|| at + 1),
        (at >= width).then(|| at - width),
        (at + width < count).then(|| at + width),
    ]
    .into_iter()
    .flatten()
}

/// The pixel of `component` farthest from every pixel outside it.
fn deepest(component: &[usize], width: usize) -> usize {
    let columns = || component.iter().map(|at| at % width);
    let left = columns().min().unwrap_or(0);
    let right = columns().max().unwrap_or(0);
    let top = component[0] / width;
    let bottom = component[component.len() - 1] / width;
    // One pixel of margin all around stands for what lies outside, beyond the picture's border too.
    let (box_width, box_height) = (right - left + 3, bottom - top + 3);
    let mut squares = vec![0.0f32; box_width * box_height];
    for at in component {
        squares[(at / width - top + 1) * box_width + at % width - left + 1] = f32::INFINITY;
    }
    squared_distances(&mut squares, box_width, box_height);
    let depth = |at: usize| squares[(at / width - top + 1) * box_width + at % width - left + 1];
    component.iter().copied().fold(component[0], |best, at| if depth(at) > depth(best) { at } else { best })
}

/// Exact squared Euclidean distance to the nearest zero (Felzenszwalb and Huttenlocher, "Distance transforms of
/// sampled functions", Theory of Computing 2012). Zeros stay, infinity becomes the distance.
fn squared_distances(values: &mut [f32], width: usize, height: usize) {
    let mut line = vec![0.0; width.max(height)];
    let mut hull = vec![(0usize, 0.0f32); width.max(height)];
    for x in 0..width {
        for y in 0..height {
            line[y] = values[y * width + x];
        }
        lower_envelope(&line[..height], &mut hull, |y, value| values[y * width + x] = value);
    }
    for row in values.chunks_exact_mut(width) {
        line[..width].copy_from_slice(row);
        lower_envelope(&line[..width], &mut hull, |x, value| row[x] = value);
    }
}

/// One line of the transform: the lower envelope of parabolas rooted at the finite samples.
fn lower_envelope(samples: &[f32], hull: &mut [(usize, f32)], mut set: impl FnMut(usize, f32)) {
    let mut count = 0;
    for (at, &sample) in samples.iter().enumerate() {
        if !sample.is_finite() {
            continue;
        }
        let mut from = f32::NEG_INFINITY;
        while count > 0 {
            let (other, other_from) = hull[count - 1];
            let (p, q) = (at as f32, other as f32);
            from = (sample + p * p - samples[other] - q * q) / (2.0 * (p - q));
            if from > other_from {
                break;
            }
            from = f32::NEG_INFINITY;
            count -= 1;
        }
        hull[count] = (at, from);
        count += 1;
    }
    let mut piece = 0;
    for at in 0..samples.len() {
        if count == 0 {
            return;
        }
        while piece + 1 < count && hull[piece + 1].1 <= at as f32 {
            piece += 1;
        }
        let (root, _) = hull[piece];
        let along = at as f32 - root as f32;
        set(at, samples[root] + along * along);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(rows: &[&str]) -> Region {
        Region {
            width: rows[0].len() as u32,
            height: rows.len() as u32,
            inside: rows.iter().flat_map(|row| row.bytes().map(|byte| byte == b'#')).collect(),
        }
    }

    #[test]
    fn first_click_is_the_deepest_point_of_the_object() {
        let truth = region(&["........", ".#####..", ".#####..", ".#####..", ".#####..", ".#####..", "........"]);
        let click = next_click(&truth, &Region::empty(8, 7)).unwrap();
        assert_eq!((click.at_px, click.include), (DVec2::new(3.5, 3.5), true));
    }

    #[test]
    fn too_much_gives_an_exclude_click_in_the_larger_error() {
        let truth = region(&["##......", "##......", "........", "........"]);
        let answer = region(&[".#..####", "##..####", "....####", "........"]);
        let click = next_click(&truth, &answer).unwrap();
        assert_eq!((click.at_px, click.include), (DVec2::new(5.5, 1.5), false));
    }

    #[test]
    fn nothing_to_correct_gives_no_click() {
        let truth = region(&["##..", "...."]);
        assert_eq!(next_click(&truth, &truth), None);
    }

    #[test]
    fn distances_equal_those_of_a_full_search() {
        let (width, height) = (13usize, 9usize);
        let zeros: Vec<usize> = vec![3, 40, 41, 77, 100];
        let mut fast = vec![f32::INFINITY; width * height];
        zeros.iter().for_each(|&at| fast[at] = 0.0);
        squared_distances(&mut fast, width, height);
        for (at, &found) in fast.iter().enumerate() {
            let square = |zero: &usize| {
                let dx = (at % width) as f32 - (zero % width) as f32;
                let dy = (at / width) as f32 - (zero / width) as f32;
                dx * dx + dy * dy
            };
            let exact = zeros.iter().map(square).fold(f32::INFINITY, f32::min);
            assert!((found - exact).abs() < 1e-4, "pixel {at}: {found} instead of {exact}");
        }
    }
}
