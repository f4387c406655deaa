use super::seeing::Pixel;
use ostra_masks::{Connectivity, LabelId, LabelMask, Region, components};

/// How far a label's pixels of which nothing is known go with those that see something, as a share of the longer side.
const REACH: f64 = 1.0 / 40.0;
/// Pixels without a label go along so far only: a mask that says nothing does not hold them together.
const UNLABELLED_REACH: usize = 2;

/// Gives pixels that see nothing known to the chosen ones: those that are nearest to chosen ones along pixels of the same
/// label in `mask`, and holes without a label that chosen pixels enclose.
pub(super) fn close_blind(pixels: &mut [Pixel], mask: &LabelMask) {
    let mut known: Vec<Pixel> = pixels.to_vec();
    let mut front: Vec<usize> = (0..pixels.len())
        .filter(|&at| pixels[at] != Pixel::Blind)
        .collect();
    let reach = (REACH * f64::from(mask.width.max(mask.height))).ceil() as usize;
    for step in 0..reach {
        let mut next = Vec::new();
        for at in front {
            let goes_on = mask.ids[at] != LabelId::NONE || step < UNLABELLED_REACH;
            for other in beside(at, mask).filter(|_| goes_on) {
                if known[other] == Pixel::Blind && mask.ids[other] == mask.ids[at] {
                    known[other] = known[at];
                    next.push(other);
                }
            }
        }
        front = next;
    }
    let holes = holes(&known, mask);
    for (at, pixel) in pixels.iter_mut().enumerate() {
        if known[at] == Pixel::Chosen || holes[at] {
            *pixel = Pixel::Chosen;
        }
    }
}

/// The pixels without a label, of which nothing is known, that chosen pixels enclose on all sides.
fn holes(known: &[Pixel], mask: &LabelMask) -> Vec<bool> {
    let inside = known
        .iter()
        .zip(&mask.ids)
        .map(|(&pixel, &id)| pixel == Pixel::Blind && id == LabelId::NONE)
        .collect();
    let unknown = components(
        &Region {
            width: mask.width,
            height: mask.height,
            inside,
        },
        Connectivity::Four,
    );
    let mut open = vec![false; unknown.areas.len() + 1];
    open[0] = true;
    for at in (0..known.len()).filter(|&at| unknown.labels[at] > 0) {
        let own = unknown.labels[at];
        let closed = beside(at, mask)
            .filter(|&other| unknown.labels[other] == own || known[other] == Pixel::Chosen);
        open[own as usize] |= closed.count() < 4;
    }
    unknown
        .labels
        .iter()
        .map(|&piece| !open[piece as usize])
        .collect()
}

/// The pixels left, right, above and below.
fn beside(at: usize, mask: &LabelMask) -> impl Iterator<Item = usize> + use<> {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let (x, y) = (at % width, at / width);
    let left = (x > 0).then(|| at - 1);
    let right = (x + 1 < width).then_some(at + 1);
    let above = (y > 0).then(|| at - width);
    let below = (y + 1 < height).then_some(at + width);
    [left, right, above, below].into_iter().flatten()
}
