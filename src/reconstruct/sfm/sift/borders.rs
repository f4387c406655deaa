/// Brightest line that a bar may begin with, in grey.
const DARKEST: f32 = 20.0 / 255.0;
/// Farthest that a pixel of a bar may be from the bar's grey: compression leaves traces beside the edge.
const SPREAD: f32 = 8.0 / 255.0;
/// Fewest lines of a bar: what is narrower is a frame's dark rim.
const NARROWEST: usize = 4;
/// Lines beyond the edge that are looked at to tell a bar from a dark background.
const BEYOND: usize = 4;
/// Least share of these that must differ from the bar, since a bar ends everywhere at once.
const LEAST_CONTENT: f32 = 0.5;

/// The part of a picture inside near-black bars at its sides; features whose surroundings touch the bars would stand
/// still where the scene moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Content {
    /// First and past-the-last column; infinitely far where there is no bar.
    pub columns: (f32, f32),
    /// First and past-the-last row.
    pub rows: (f32, f32),
}

impl Content {
    /// Finds the bars of a grey picture.
    pub fn of(grey: &[f32], width: usize, height: usize) -> Self {
        let [columns, rows] = [(width, height, 1, width), (height, width, width, 1)].map(
            |(lines, len, step, along)| {
                let bar = |line: &dyn Fn(usize) -> usize| {
                    bar(lines, len, &|k, at| grey[line(k) * step + at * along])
                };
                let (before, after) = (bar(&|k| k), bar(&|k| lines - 1 - k));
                let first = if before > 0 {
                    before as f32
                } else {
                    f32::NEG_INFINITY
                };
                (
                    first,
                    if after > 0 {
                        (lines - after) as f32
                    } else {
                        f32::INFINITY
                    },
                )
            },
        );
        Self { columns, rows }
    }

    /// Whether a disc lies inside.
    pub fn holds(&self, at: glam::Vec2, radius: f32) -> bool {
        let inside =
            |at: f32, (first, last): (f32, f32)| at - radius >= first && at + radius <= last;
        inside(at.x, self.columns) && inside(at.y, self.rows)
    }
}

/// Lines of the bar that begins at line 0 of `lines` lines of `len` pixels; 0 = none.
fn bar(lines: usize, len: usize, pixel: &dyn Fn(usize, usize) -> f32) -> usize {
    if lines == 0 || len == 0 {
        return 0;
    }
    let mean = (0..len).map(|at| pixel(0, at)).sum::<f32>() / len as f32;
    let belongs = |line: usize| (0..len).all(|at| (pixel(line, at) - mean).abs() <= SPREAD);
    let count = (0..lines)
        .take_while(|&line| mean <= DARKEST && belongs(line))
        .count();
    if count < NARROWEST || count == lines {
        return 0;
    }
    let beyond = (count + BEYOND).min(lines - 1);
    let content = (0..len)
        .filter(|&at| (pixel(beyond, at) - mean).abs() > SPREAD)
        .count();
    if content as f32 >= LEAST_CONTENT * len as f32 {
        count
    } else {
        0
    }
}
