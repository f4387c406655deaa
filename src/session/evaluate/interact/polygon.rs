use glam::DVec2;

use crate::masks::{Outline, Region, outlines};

/// Most corners of a ring that one side of a polygon may pass over: what bounds the work on long rings.
const REACH: usize = 64;

/// How far the corners that a side passes over lie off it, in pixels.
const OFF_PX: f64 = 10.0;

/// What filling mends of a frame: 1 for a pixel that it puts right, −1 for one that it spoils, 0 for one that it leaves as it is.
pub struct Mended {
    width: usize,
    /// For each row the sums over the pixels left of each column, `width + 1` of them.
    sums: Vec<i32>,
}

impl Mended {
    /// From the value of each pixel, row by row.
    pub fn new(width: u32, values: impl IntoIterator<Item = i8>) -> Self {
        let width = width as usize;
        let (mut sums, mut sum) = (Vec::new(), 0);
        for (at, value) in values.into_iter().enumerate() {
            if at.is_multiple_of(width) {
                sum = 0;
                sums.push(0);
            }
            sum += i32::from(value);
            sums.push(sum);
        }
        Self { width, sums }
    }

    /// The share of the side from `a` to `b` in what a polygon mends that runs clockwise as seen: what lies left of it, once
    /// for each row whose middle it passes downwards, taken away for those that it passes upwards.
    fn beside(&self, a: DVec2, b: DVec2) -> i32 {
        let (sign, top, bottom) = if a.y <= b.y { (1, a, b) } else { (-1, b, a) };
        let first = |at: f64| (at - 0.5).ceil().max(0.0) as usize;
        let slope = (bottom.x - top.x) / (bottom.y - top.y);
        let rows = first(top.y)..first(bottom.y).min(self.sums.len() / (self.width + 1));
        let left = |row: usize| {
            let x = top.x + slope * (row as f64 + 0.5 - top.y);
            self.sums[row * (self.width + 1) + first(x).min(self.width)]
        };
        sign * rows.map(left).sum::<i32>()
    }
}

/// A polygon, and what drawing it mends.
#[derive(Debug, Clone, PartialEq)]
pub struct Polygon {
    /// Its corners, holes joined by seams.
    pub ring: Vec<DVec2>,
    /// Pixels put right, less those spoilt.
    pub mended: f64,
}

/// The borders of one part of a region, and what each of their chords mends.
pub struct Borders {
    outer: Border,
    holes: Vec<Border>,
}

/// Corners of the seam to a hole and back.
const SEAM: f64 = 2.0;

impl Borders {
    /// Of the parts of a region, with no more corners than a hand draws: borders lie at most `finest_px` off between two.
    pub fn of(region: &Region, mended: &Mended, finest_px: f64) -> Vec<Self> {
        let parts = outlines(region);
        let simple = parts.iter().filter_map(|part| part.simplified(finest_px));
        let border = |ring| Border::new(ring, mended);
        simple
            .map(|part| Self { outer: border(part.outer), holes: part.holes.into_iter().map(border).collect() })
            .collect()
    }

    /// The polygon of some of the corners that mends most where each corner costs `price` pixels; `None` where none pays.
    pub fn polygon(&self, price: f64) -> Option<Polygon> {
        let (outer, worth) = self.outer.best(price)?;
        let holes: Vec<_> =
            self.holes.iter().filter_map(|hole| hole.best(price)).filter(|(_, worth)| *worth > SEAM * price).collect();
        let gained = worth + holes.iter().map(|(_, worth)| worth - SEAM * price).sum::<f64>();
        let ring = Outline { outer, holes: holes.into_iter().map(|(hole, _)| hole).collect() }.keyhole();
        let mended = gained + price * ring.len() as f64;
        (gained > 0.0).then_some(Polygon { ring, mended })
    }
}

struct Border {
    corners: Vec<DVec2>,
    /// For each corner what the sides mend that lead to it from the 1, 2, … corners before it.
    chords: Vec<Vec<Option<i32>>>,
}

impl Border {
    fn new(corners: Vec<DVec2>, mended: &Mended) -> Self {
        let count = corners.len();
        let off_px = super::outline::x("X_OFF", OFF_PX);
        let at = |corner: usize| corners[corner % count];
        let chord = |from: usize, to: usize| {
            let is_near = (from + 1..to).all(|between| off(at(between), at(from), at(to)) <= off_px);
            let along: i32 = (from..to).map(|corner| mended.beside(at(corner), at(corner + 1))).sum();
            is_near.then(|| mended.beside(at(from), at(to)).min(along))
        };
        let from = |to: usize| (1..=to.min(super::outline::x("X_REACH", 64.0) as usize)).map(|step| chord(to - step, to)).collect();
        let chords = (0..=count).map(from).collect();
        Self { corners, chords }
    }

    /// Which corners to keep, the first among them, so that what is mended less `price` for each is greatest, and how much that is:
    /// the longest path over the chords. `None` where fewer than three are left.
    fn best(&self, price: f64) -> Option<(Vec<DVec2>, f64)> {
        let mut best: Vec<(f64, usize)> = vec![(0.0, 0)];
        for (to, chords) in self.chords.iter().enumerate().skip(1) {
            let steps = chords.iter().zip(1..).filter_map(|(mends, step)| Some((f64::from((*mends)?), step)));
            let through = steps.map(|(mends, step)| (best[to - step].0 + mends - price, step));
            best.extend(through.max_by(|a, b| a.0.total_cmp(&b.0)));
        }
        let (mut at, mut kept) = (self.corners.len(), Vec::new());
        while at > 0 {
            at -= best[at].1;
            kept.push(self.corners[at]);
        }
        kept.reverse();
        (kept.len() >= 3).then_some((kept, best.last()?.0))
    }
}

fn off(point: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = b - a;
    let length2 = along.length_squared();
    let share = if length2 > 0.0 { ((point - a).dot(along) / length2).clamp(0.0, 1.0) } else { 0.0 };
    point.distance(a + share * along)
}
