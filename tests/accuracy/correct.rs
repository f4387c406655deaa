//! Tests of 3-D label corrections that are written back into the masks, on a real recording.

use std::path::Path;

use glam::DVec2;
use ostra_cloud::select::{Eye, Likeness, SeenRegion, SelectStep};
use ostra_masks::{
    LabelId, LabelMask, MaskFormat, Region, RunMask, encode_palette_png, read_palette_png,
};
use ostra_project::{FuseRequest, MaskOrigin};
use ostra_session::{CloudChange, CloudCorrection, Command, Session};

use crate::data::data_dir;
use crate::session::{perform, shown_bytes};
use crate::shelf::new_project;

pub(super) const TISSUES: LabelId = LabelId(3);
pub(super) const JOKES: LabelId = LabelId(4);
pub(super) const FRAMES: usize = 15;

pub(super) fn truth(data: &Path, frame: usize) -> LabelMask {
    read_palette_png(&data.join(format!("apc_shelf_rgbd_labels/labels/{frame:06}.png"))).unwrap()
}

/// Returns the fused shelf with wrong masks: the box of tissues is labelled as the book.
pub(super) fn wrongly_labelled(data: &Path, folder: &Path) -> Session {
    let mut session = Session::new();
    perform(&mut session, new_project(data, &folder.join("shelf"))).unwrap();
    for name in ["stems", "bunny", "tissues", "jokes"] {
        perform(
            &mut session,
            Command::AddLabel {
                name: name.into(),
                parent: None,
                color: None,
            },
        )
        .unwrap();
    }
    let masks = folder.join("masks");
    std::fs::create_dir(&masks).unwrap();
    for frame in 0..FRAMES {
        let wrong = RunMask::encode(&truth(data, frame))
            .map_ids(|id| if id == TISSUES { JOKES } else { id });
        let png = encode_palette_png(&wrong, &session.project().unwrap().labels).unwrap();
        std::fs::write(masks.join(format!("{frame:06}.png")), png).unwrap();
    }
    perform(
        &mut session,
        Command::ImportMasks {
            dir: masks,
            format: MaskFormat::Davis,
        },
    )
    .unwrap();
    let fuse = FuseRequest {
        voxel: Some(0.004),
        ..FuseRequest::default()
    };
    perform(&mut session, Command::Fuse(fuse)).unwrap();
    session
}

/// Returns a selection of the box as seen in frame 7, reduced to its largest part.
///
/// It includes all layers that noisy depth gave the faces of the box.
fn the_box() -> Vec<SelectStep> {
    let corners = [
        [215.0, 190.0],
        [355.0, 190.0],
        [355.0, 345.0],
        [215.0, 345.0],
    ];
    let seen = SeenRegion {
        eye: Eye::Frame(7),
        points_px: corners.map(DVec2::from_array).to_vec(),
        radius_px: 0.0,
        remove: false,
        hidden: Vec::new(),
        isolated: None,
        uncertain_below: None,
        cube_from_world: None,
    };
    let (only, likeness) = (
        SelectStep::Only(JOKES),
        Likeness {
            normal_deg: 180.0,
            color: 50.0,
        },
    );
    vec![
        SelectStep::Seen(seen),
        only.clone(),
        SelectStep::Grow(likeness),
        only,
        SelectStep::Piece(0),
    ]
}

fn share(inside: &Region, mask: &LabelMask, label: LabelId) -> f64 {
    let hit = mask
        .region(label)
        .inside
        .iter()
        .zip(&inside.inside)
        .filter(|(a, b)| **a && **b)
        .count();
    hit as f64 / inside.area().max(1) as f64
}

fn lasso_in_3d_corrects_a_label_in_all_masks_and_undo_restores_the_bytes() {
    let data = data_dir();
    let folder = tempfile::tempdir().unwrap();
    let mut session = wrongly_labelled(&data, folder.path());
    let (before, bytes) = (
        session.project().unwrap().clone(),
        shown_bytes(&mut session),
    );
    let correction = CloudCorrection {
        select: the_box(),
        change: CloudChange::Assign(TISSUES),
        as_keyframes: true,
    };
    perform(&mut session, Command::CorrectCloud(correction)).unwrap();
    assert_eq!(session.undo_title(), Some("Assign tissues in 3-D"));
    let after = session.project().unwrap().clone();
    let mut mean = 0.0;
    for frame in 0..FRAMES {
        let (truth, mask) = (truth(&data, frame), after.masks[&frame].runs.decode());
        let (moved, kept) = (
            share(&truth.region(TISSUES), &mask, TISSUES),
            share(&truth.region(JOKES), &mask, JOKES),
        );
        println!("frame {frame}: {moved:.3} moved, {kept:.3} kept");
        assert!(
            moved > 0.8,
            "frame {frame}: {moved} of the box has its label"
        );
        assert!(
            kept > 0.99,
            "frame {frame}: {kept} of the book keeps its own"
        );
        mean += moved / FRAMES as f64;
        assert_eq!(after.masks[&frame].origin, MaskOrigin::Keyframe);
    }
    assert!(mean > 0.93, "{mean}");
    assert!(
        after.results.values().all(|record| !record.stale),
        "{:?}",
        after.results
    );
    assert!(
        session.cloud().unwrap().labels.contains(&TISSUES),
        "the cloud is labelled at once"
    );
    perform(&mut session, Command::Undo).unwrap();
    assert_eq!(session.project().unwrap(), &before);
    assert!(
        shown_bytes(&mut session) == bytes,
        "the same bytes as before"
    );
}

crate::registry::tests! {
    Data(&["apc_shelf_rgbd_labels"]) =>
        lasso_in_3d_corrects_a_label_in_all_masks_and_undo_restores_the_bytes;
}
