use std::sync::Arc;

use ostra_cloud::conflicts::MaskedFrame;
use ostra_cloud::correct::SeeingPixels;
use ostra_cloud::fuse::Fused;
use ostra_cloud::select::{SelectStep, Selection, Selector};
use ostra_core::job::Progress;
use ostra_masks::Region;

use super::Rendered;
use crate::synthetic::SceneOptions;

/// Returns the synthetic plant with organ labels.
fn plant() -> Rendered {
    Rendered::new(
        &SceneOptions {
            views: 8,
            width: 240,
            height: 320,
            ..SceneOptions::default()
        },
        Some(2),
    )
}

/// Returns the pixels of each frame that see the selected points.
fn seeing(
    plant: &Rendered,
    fused: &Fused,
    selector: &Selector,
    selection: &Selection,
    by_depth: bool,
) -> Vec<Option<Region>> {
    let seeing = SeeingPixels::new(selector, &fused.votes, selection).unwrap();
    let region = |number: usize| {
        let depth = by_depth.then_some(&plant.views[number].depth);
        seeing.in_frame(&MaskedFrame {
            number,
            frame: &plant.frames[number],
            depth,
            mask: &plant.masks[number],
        })
    };
    (0..plant.frames.len()).map(region).collect()
}

fn chosen(fused: &Fused, steps: &[SelectStep]) -> (Selector, Selection) {
    let selector = Selector::new(Arc::new(fused.cloud.clone())).unwrap();
    let selection = selector
        .select(&[], &fused.cloud.tree, steps, &Progress::default())
        .unwrap();
    (selector, selection)
}

#[test]
fn pixels_that_see_an_organ_match_its_mask() {
    let plant = plant();
    let fused = plant.fused();
    for name in ["leaf", "panicle"] {
        let label = plant.label(name);
        let (selector, selection) = chosen(&fused, &[SelectStep::Label(label)]);
        for (least, by_depth) in [(0.93, true), (0.8, false)] {
            for (number, region) in seeing(&plant, &fused, &selector, &selection, by_depth)
                .into_iter()
                .enumerate()
            {
                let iou = region.unwrap().iou(&plant.masks[number].region(label));
                assert!(
                    iou > least,
                    "{name} on frame {number}, by depth {by_depth}: {iou}"
                );
            }
        }
    }
}

#[test]
fn written_back_label_wins_the_vote_and_other_points_are_kept() {
    let mut plant = plant();
    let before = plant.fused();
    let (panicle, stem) = (plant.label("panicle"), plant.label("stem"));
    let (selector, selection) =
        chosen(&before, &[SelectStep::Label(panicle), SelectStep::Piece(0)]);
    let regions = seeing(&plant, &before, &selector, &selection, true);
    for (mask, region) in plant.masks.iter_mut().zip(regions.into_iter().flatten()) {
        mask.ids
            .iter_mut()
            .zip(region.inside)
            .filter(|(_, inside)| *inside)
            .for_each(|(id, _)| *id = stem);
    }
    let after = plant.fused();
    assert_eq!(after.cloud.positions, before.cloud.positions);
    let is_chosen = |point: usize| selection.points.binary_search(&(point as u32)).is_ok();
    let voted = |point: &usize| !before.votes.histogram(*point).is_empty();
    let moved = selection
        .points
        .iter()
        .filter(|&&point| after.cloud.labels[point as usize] == stem)
        .count();
    assert!(
        moved * 1000 >= selection.points.len() * 995,
        "{moved} of {}",
        selection.points.len()
    );
    let others: Vec<usize> = (0..before.cloud.len())
        .filter(voted)
        .filter(|&point| !is_chosen(point))
        .collect();
    let kept = others
        .iter()
        .filter(|&&point| after.cloud.labels[point] == before.cloud.labels[point])
        .count();
    assert!(
        kept * 1000 >= others.len() * 998,
        "{kept} of {}",
        others.len()
    );
}

#[test]
fn empty_selection_gives_no_region_and_foreign_votes_are_an_error() {
    let plant = plant();
    let fused = plant.fused();
    let selector = Selector::new(Arc::new(fused.cloud.clone())).unwrap();
    let none = seeing(&plant, &fused, &selector, &Selection::default(), true);
    assert!(none.iter().all(Option::is_none));
    let other = fused.votes.select(&[0, 1]);
    assert!(SeeingPixels::new(&selector, &other, &Selection::default()).is_err());
}
