use super::anchor::Anchor;
use super::draw::{Drawn, draw};
use super::options::CarryOptions;
use super::sightings::Sightings;
use super::tolerance::Tolerance;
use super::viewpoint::{Passage, Viewpoint};
use ostra_core::job::{Progress, Stopped};

/// What an anchor says of a target: pixels with depth are looked up in the anchor, which answers where its depth agrees;
/// where the target has no depth the anchor's surfaces are drawn into it, and into the holes of `drawn`.
pub fn ask(
    anchor: &Anchor,
    target: &Viewpoint,
    tolerance: &Tolerance,
    drawn: &mut [f32],
    options: &CarryOptions,
    progress: &Progress,
) -> Result<Sightings, Stopped> {
    let mut sightings = Sightings::none(target.rays.len());
    look_up(anchor, target, tolerance, &mut sightings, progress)?;
    draw_in_holes(anchor, target, drawn, options, &mut sightings, progress)?;
    Ok(sightings)
}

fn look_up(
    anchor: &Anchor,
    target: &Viewpoint,
    tolerance: &Tolerance,
    sightings: &mut Sightings,
    progress: &Progress,
) -> Result<(), Stopped> {
    let passage = Passage::new(&target.stand, &anchor.view.stand);
    for at in 0..target.rays.len() {
        if at % 16384 == 0 {
            progress.check()?;
        }
        let Some(point) = target.point(at) else {
            continue;
        };
        let moved = passage.transform(point);
        let Some(px) = passage.pixel(moved) else {
            continue;
        };
        let (x, y) = (px.x as usize, px.y as usize);
        match surface_at(&anchor.view, x, y, moved.z, tolerance) {
            Found::Surface(hit, agreement) => {
                let nearness = (point.z / moved.z).min(1.0);
                sightings.set(
                    at,
                    anchor.mask.ids[hit],
                    agreement * nearness * anchor.trust[hit],
                );
            }
            Found::Behind => sightings.set_through(at),
            Found::Nothing => {}
        }
    }
    Ok(())
}

fn draw_in_holes(
    anchor: &Anchor,
    target: &Viewpoint,
    depths: &mut [f32],
    options: &CarryOptions,
    sightings: &mut Sightings,
    progress: &Progress,
) -> Result<(), Stopped> {
    let mut canvas = vec![Drawn::NOTHING; target.rays.len()];
    draw(&anchor.view, target, &mut canvas, progress)?;
    for (at, drawn) in canvas.iter().enumerate() {
        if drawn.depth < f32::INFINITY && target.depth.depths[at] <= 0.0 {
            let from = drawn.from as usize;
            depths[at] = if depths[at] > 0.0 {
                depths[at].min(drawn.depth)
            } else {
                drawn.depth
            };
            sightings.set(
                at,
                anchor.mask.ids[from],
                options.drawn_weight * anchor.trust[from],
            );
        }
    }
    Ok(())
}

/// What a view has at the place of another one's surface.
enum Found {
    /// The pixel that shows it, and how well its depth agrees, 0–1.
    Surface(usize, f32),
    /// Only what lies farther away: the place is empty.
    Behind,
    /// Something before it, or no depth.
    Nothing,
}

/// The pixel in or beside (`x`, `y`) whose surface lies at depth `z`. Looking at the neighbours too makes slanted surfaces
/// count, and outlines, where depth and picture are a pixel apart.
fn surface_at(view: &Viewpoint, x: usize, y: usize, z: f32, tolerance: &Tolerance) -> Found {
    let (width, height) = (view.width(), view.height());
    let limit = tolerance.at(z);
    let depth = &view.depth.depths;
    let off = |at: usize| {
        if depth[at] > 0.0 {
            (depth[at] - z).abs()
        } else {
            f32::INFINITY
        }
    };
    let here = y * width + x;
    let (mut best, mut least, mut share) = (here, off(here), 1.0);
    let mut is_behind = true;
    if least > limit {
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        for at in rows.flat_map(|row| columns.clone().map(move |column| row * width + column)) {
            is_behind &= depth[at] > z + limit;
            if off(at) < least {
                (best, least, share) = (at, off(at), 0.5);
            }
        }
    }
    let ratio = least / limit;
    match (ratio <= 1.0, is_behind) {
        (true, _) => Found::Surface(best, share * (1.0 - 0.75 * ratio * ratio)),
        (false, true) => Found::Behind,
        (false, false) => Found::Nothing,
    }
}
