use super::draw::{Drawn, draw};
use super::tolerance::Tolerance;
use super::viewpoint::Viewpoint;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::DepthMap;

/// The depth of `view` with its holes filled by what other frames see there, where two of them agree (or the only one
/// that sees it).
#[derive(Debug)]
pub struct Completion<'a> {
    view: &'a Viewpoint,
    tolerance: Tolerance,
    /// Pixels without depth, in order.
    holes: Vec<u32>,
    /// Depths drawn at each hole.
    drawn: Vec<Vec<f32>>,
}

impl<'a> Completion<'a> {
    pub fn new(view: &'a Viewpoint, tolerance: Tolerance) -> Self {
        let depths = view.depth.depths.iter().zip(0..);
        let holes: Vec<u32> = depths
            .filter(|&(&depth, _)| depth <= 0.0)
            .map(|(_, at)| at)
            .collect();
        let drawn = vec![Vec::new(); holes.len()];
        Self {
            view,
            tolerance,
            holes,
            drawn,
        }
    }

    /// Draws another frame's surfaces.
    pub fn add(&mut self, source: &Viewpoint, progress: &Progress) -> Result<(), Stopped> {
        let mut canvas = vec![Drawn::NOTHING; self.view.rays.len()];
        draw(source, self.view, &mut canvas, progress)?;
        for (&hole, drawn) in self.holes.iter().zip(&mut self.drawn) {
            let depth = canvas[hole as usize].depth;
            if depth < f32::INFINITY {
                drawn.push(depth);
            }
        }
        Ok(())
    }

    pub fn finish(mut self) -> DepthMap {
        let mut filled = (*self.view.depth).clone();
        for (&hole, drawn) in self.holes.iter().zip(&mut self.drawn) {
            filled.depths[hole as usize] = agreed(drawn, &self.tolerance);
        }
        filled
    }
}

/// The middle of the largest group of depths that agree, the nearest of equally large ones; 0 where there is none.
fn agreed(depths: &mut [f32], tolerance: &Tolerance) -> f32 {
    depths.sort_by(f32::total_cmp);
    let (mut most, mut middle) = (0, 0.0);
    for (first, &depth) in depths.iter().enumerate() {
        let limit = depth + 2.0 * tolerance.at(depth);
        let count = depths[first..]
            .iter()
            .take_while(|&&other| other <= limit)
            .count();
        if count > most {
            (most, middle) = (count, depths[first + count / 2]);
        }
    }
    if most >= depths.len().min(2) {
        middle
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_depth_that_most_agree_on_is_taken() {
        let tolerance = Tolerance::new(0.01, 1.0);
        assert_eq!(agreed(&mut [], &tolerance), 0.0);
        assert_eq!(agreed(&mut [0.7], &tolerance), 0.7);
        assert_eq!(
            agreed(&mut [0.7, 1.2], &tolerance),
            0.0,
            "two that contradict each other"
        );
        assert_eq!(agreed(&mut [1.21, 0.7, 1.2], &tolerance), 1.21);
        assert_eq!(
            agreed(&mut [1.2, 0.7, 1.2, 0.701], &tolerance),
            0.701,
            "the nearer of two equally large groups"
        );
    }
}
