use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{StereoEngine, assert_equal, card};
use crate::stereo::patchmatch::{DepthSearch, PatchMatchOptions, PlaneMap, PosedImage, Round};
use crate::stereo::raster::{raster_camera, raster_image, tones};
use ostra_core::job::Progress;
use ostra_frames::cameras::GivenCameras;
use ostra_frames::{FrameFolder, FrameStore, OpenRequest, open};

/// Longer side that the images are reduced to.
const SIDE: u32 = 260;

/// Returns the folder of a real set.
fn fountain() -> PathBuf {
    let named = std::env::var_os("OSTRA_DATA").map(PathBuf::from);
    let data =
        named.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"));
    let set = data.join("strecha_fountain_P11");
    assert!(set.is_dir(), "{} is missing", set.display());
    set
}

/// Reads three neighbouring views.
fn images(set: &Path) -> Vec<Arc<PosedImage>> {
    let request = OpenRequest {
        sources: vec![FrameFolder::from(set.join("images"))],
        ..OpenRequest::default()
    };
    let mut frames = open(&request, &Progress::default()).unwrap().frames;
    GivenCameras::read(&set.join("sparse"))
        .unwrap()
        .match_to(&mut frames)
        .unwrap();
    let store = FrameStore::new(16 << 20);
    let image = |frame: &ostra_frames::Frame| {
        let (lens, pose) = frame.posed_camera().unwrap();
        let image = raster_image(frame, lens, &store, SIDE).unwrap();
        Arc::new(PosedImage::new(
            tones(&image),
            raster_camera(lens, SIDE),
            *pose,
            120,
        ))
    };
    frames[3..6].iter().map(image).collect()
}

/// Returns the search of the first image against the others.
fn task(images: &[Arc<PosedImage>]) -> DepthSearch<'_> {
    let (reference, sources) = (&images[0], &images[1..]);
    DepthSearch {
        reference,
        sources,
        depth_range: [4.0, 16.0],
        seeds: &[],
        allowed: None,
    }
}

#[test]
#[ignore = "needs a GPU adapter and real data sets (OSTRA_DATA): add --include-ignored"]
fn real_images_give_the_same_depths_as_the_processor() {
    let card = card();
    let set = fountain();
    let images = images(&set);
    let (options, progress) = (PatchMatchOptions::default(), Progress::default());
    let mut founds: Vec<Arc<PlaneMap>> = Vec::new();
    for index in 0..3 {
        let mut order = images.clone();
        order.swap(0, index);
        founds.push(
            StereoEngine::Cpu
                .search(&task(&order), &options, &progress)
                .unwrap()
                .into(),
        );
    }
    let task = task(&images);
    assert_equal(
        &card,
        &founds[0],
        &card.search(&task, &options, &progress).unwrap(),
        "fountain",
    );
    let others: Vec<_> = founds[1..].iter().cloned().map(Some).collect();
    let round = Round {
        start: &founds[0],
        others: &others,
        before: 0,
    };
    let cpu = StereoEngine::Cpu
        .search_consistent(&task, &round, &options, &progress)
        .unwrap();
    let gpu = card
        .search_consistent(&task, &round, &options, &progress)
        .unwrap();
    assert_equal(&card, &cpu, &gpu, "fountain, consistent");
}
