//! Speed and peak memory of the geometry tracker on `redkitchen_rgbd_a`, decoding included.
//!
//! Another data set with `color`, `depth` and `sparse` can be named.
//!
//! `cargo bench --bench transfer [-- SET]`

use std::collections::BTreeMap;
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use ostra_core::job::Progress;
use ostra_frames::cameras::GivenCameras;
use ostra_frames::{FrameFolder, FrameStore, OpenRequest, open};
use ostra_masks::{Direction, LabelId, LabelMask, TrackRequest, Tracker};
use ostra_tracking::reprojection::GeometryTracker;

#[expect(clippy::print_stdout, reason = "a bench speaks to the user")]
fn main() -> Result<(), Box<dyn Error>> {
    let set = std::env::args()
        .nth(1)
        .filter(|word| !word.starts_with("--"));
    let data = std::env::var_os("OSTRA_DATA")
        .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let set = data.join(set.as_deref().unwrap_or("redkitchen_rgbd_a"));
    let source = FrameFolder {
        frames: set.join("color"),
        depth: Some(set.join("depth")),
    };
    let mut frames = open(
        &OpenRequest {
            sources: vec![source],
            ..OpenRequest::default()
        },
        &Progress::default(),
    )?
    .frames;
    GivenCameras::read(&set.join("sparse"))?.match_to(&mut frames)?;
    // Two keyframes of three upright stripes each: enough labels and borders for a realistic cost.
    let striped = |width: u32, height: u32| {
        let id = |at: u32| LabelId((4 * (at % width) / width) as u16);
        LabelMask {
            width,
            height,
            ids: (0..width * height).map(id).collect(),
        }
    };
    let keyframes = [frames.len() / 4, 3 * frames.len() / 4];
    let keyframes: BTreeMap<usize, Arc<LabelMask>> = keyframes
        .into_iter()
        .map(|k| (k, Arc::new(striped(frames[k].width, frames[k].height))))
        .collect();
    let request = TrackRequest {
        from: 0,
        to: frames.len() - 1,
        frames: Arc::new(frames),
        store: Arc::new(FrameStore::new(256 << 20)),
        keyframes,
        direction: Direction::Both,
        labels: None,
    };
    let begun = Instant::now();
    let mut done = 0;
    GeometryTracker::default().track(&request, &mut |_| done += 1, &Progress::default())?;
    let seconds = begun.elapsed().as_secs_f64();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status
        .lines()
        .find(|line| line.starts_with("VmHWM"))
        .unwrap_or("peak memory unknown");
    println!(
        "{done} frames in {seconds:.2} s: {:.1} frames/s, {peak}",
        f64::from(done) / seconds
    );
    Ok(())
}
