//! scratch
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use ostra::engine::job::Progress;
use ostra::frames::cameras::GivenCameras;
use ostra::frames::{Frame, FrameFolder, FrameStore, OpenRequest, open};
use ostra::masks::{Direction, LabelId, LabelMask, TrackRequest, TrackedFrame, Tracker};
use ostra::scene::GeometryTracker;

fn frames_of(folder: &PathBuf) -> Vec<Frame> {
    let sources = vec![FrameFolder { frames: folder.join("color"), depth: Some(folder.join("depth")) }];
    let mut frames = open(&OpenRequest { sources, ..OpenRequest::default() }, &Progress::default()).unwrap().frames;
    GivenCameras::read(folder).unwrap().match_to(&mut frames).unwrap();
    frames
}

fn iou(a: &LabelMask, b: &LabelMask, l: LabelId) -> f64 {
    let (mut i, mut u) = (0, 0);
    for (&p, &q) in a.ids.iter().zip(&b.ids) {
        i += usize::from(p == l && q == l);
        u += usize::from(p == l || q == l);
    }
    if u == 0 { 1.0 } else { i as f64 / u as f64 }
}

fn track(frames: &Arc<Vec<Frame>>, anchors: BTreeMap<usize, Arc<LabelMask>>) -> (Vec<TrackedFrame>, f64) {
    let request = TrackRequest {
        frames: frames.clone(),
        store: Arc::new(FrameStore::new(64 << 20)),
        anchors,
        from: 0,
        to: frames.len() - 1,
        direction: Direction::Both,
    };
    let mut out = Vec::new();
    let t = Instant::now();
    let w = GeometryTracker::default().track(&request, &mut |f| out.push(f), &Progress::default()).unwrap();
    for w in w {
        println!("{w}");
    }
    (out, t.elapsed().as_secs_f64())
}

fn save(frame: &Frame, mask: &LabelMask, truth: &LabelMask, name: &str) {
    let store = FrameStore::new(0);
    let image = store.image(frame).unwrap();
    let pal = [[0, 0, 0], [230, 75, 60], [60, 180, 75], [65, 105, 235], [255, 205, 40u8]];
    let (w, h) = (image.width, image.height);
    let mut out = image::RgbImage::new(2 * w, h);
    for (k, m) in [mask, truth].into_iter().enumerate() {
        for y in 0..h {
            for x in 0..w {
                let c = image.at(x, y);
                let l = m.at(x, y).0 as usize % 5;
                let v = if l == 0 {
                    c
                } else {
                    std::array::from_fn(|i| ((u16::from(c[i]) + u16::from(pal[l][i])) / 2) as u8)
                };
                out.put_pixel(x + k as u32 * w, y, image::Rgb(v));
            }
        }
    }
    out.save(name).unwrap();
}

fn main() {
    let data = PathBuf::from("/work/shared/data");
    let folder = data.join("apc_shelf_rgbd_labels");
    let frames = Arc::new(frames_of(&folder));
    let truth: Vec<LabelMask> = (0..frames.len())
        .map(|i| {
            let p = image::open(folder.join(format!("labels/{i:06}.png"))).unwrap().to_luma8();
            LabelMask {
                width: p.width(),
                height: p.height(),
                ids: p.pixels().map(|p| LabelId(u16::from(p.0[0]))).collect(),
            }
        })
        .collect();
    // one label per anchor, or all labels of one anchor
    let best = [11usize, 10, 10, 14];
    let mut runs: Vec<(String, BTreeMap<usize, LabelMask>)> = Vec::new();
    let only = |frame: usize, labels: &[u16], map: &mut BTreeMap<usize, LabelMask>| {
        let m = map.entry(frame).or_insert_with(|| LabelMask::empty(640, 480));
        for (id, t) in m.ids.iter_mut().zip(&truth[frame].ids) {
            if labels.contains(&t.0) {
                *id = *t;
            }
        }
    };
    let mut map = BTreeMap::new();
    for (l, &f) in best.iter().enumerate() {
        only(f, &[l as u16 + 1], &mut map);
    }
    runs.push(("best".into(), map));
    let few = std::env::var("FEW").is_ok();
    for f in 0..15 {
        if few && f % 4 != 2 {
            continue;
        }
        let mut map = BTreeMap::new();
        only(f, &[1, 2, 3, 4], &mut map);
        runs.push((format!("all{f}"), map));
    }
    let mut total = 0.0;
    let mut n = 0.0;
    if std::env::var("NOAPC").is_ok() {
        runs.clear();
    }
    for (name, anchors) in runs {
        let arcs: BTreeMap<usize, Arc<LabelMask>> = anchors.iter().map(|(&k, v)| (k, Arc::new(v.clone()))).collect();
        let (out, t) = track(&frames, arcs);
        let mut per = [0.0; 4];
        for (l, p) in per.iter_mut().enumerate() {
            let label = LabelId(l as u16 + 1);
            // other frames only: skip frames in which this label is an anchor's
            let v: Vec<f64> = out.iter().map(|o| iou(&o.mask, &truth[o.frame], label)).collect();
            *p = v.iter().sum::<f64>() / v.len() as f64;
        }
        let mean = per.iter().sum::<f64>() / 4.0;
        println!(
            "{name:6} mean {mean:.3}  {:.3} {:.3} {:.3} {:.3}   {:.1} fps",
            per[0],
            per[1],
            per[2],
            per[3],
            out.len() as f64 / t
        );
        if name != "best" {
            total += mean;
            n += 1.0;
        }
        if let Ok(dir) = std::env::var("OUT") {
            if name == "best" || name == "all2" {
                for o in &out {
                    save(&frames[o.frame], &o.mask, &truth[o.frame], &format!("{dir}/{name}_{:02}.png", o.frame));
                }
            }
        }
    }
    println!("mean over all-runs {:.3}", total / n);
    if std::env::var("SPEED").is_ok() {
        let folder = data.join("redkitchen_rgbd_a");
        let frames = Arc::new(frames_of(&folder));
        let mut mask = LabelMask::empty(640, 480);
        for y in 0..480 {
            for x in 0..640 {
                mask.ids[y * 640 + x] = LabelId(if x < 200 {
                    1
                } else if y > 300 {
                    2
                } else if x > 500 {
                    3
                } else {
                    0
                });
            }
        }
        let anchors: BTreeMap<usize, Arc<LabelMask>> =
            [0usize, 60, 120].into_iter().map(|k| (k, Arc::new(mask.clone()))).collect();
        let (out, t) = track(&frames, anchors);
        println!("redkitchen {} frames {:.1} fps", out.len(), out.len() as f64 / t);
    }
}
