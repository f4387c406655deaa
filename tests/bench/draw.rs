//! Drawing of 1, 5 and 20 million points at 1440 × 900 on the available adapter.
//!
//! Prints the time to the first image, images per second while the camera moves, and the time until
//! everything is drawn once it rests. The last two are measured again from near by, where most of
//! the points are out of view. Other numbers of points (in millions) can be given.
//!
//! Memory (Linux only) is the process's peak so far. It includes the synthetic cloud and, on a
//! software adapter, the data on the "GPU".

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench speaks to the user and may panic"
)]

use std::f32::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::Vec3;
use ostra_cloud::LabelledCloud;
use ostra_view::{Bounds, Orbit, Scene3d, SceneModel, SceneStyle, SceneView};

/// Number of images drawn while the camera moves.
const MOVES: usize = 60;
const SIZE: (u32, u32) = (1440, 900);

fn main() {
    let adapter = pollster::block_on(
        wgpu::Instance::default().request_adapter(&wgpu::RequestAdapterOptions::default()),
    )
    .unwrap();
    println!("adapter: {}", adapter.get_info().name);
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default())).unwrap();
    let given: Vec<f64> = std::env::args()
        .filter_map(|word| word.parse().ok())
        .collect();
    for millions in if given.is_empty() {
        vec![1.0, 5.0, 20.0]
    } else {
        given
    } {
        bench(&device, &queue, (millions * 1e6) as usize);
    }
}

fn bench(device: &wgpu::Device, queue: &wgpu::Queue, points: usize) {
    let cloud = Arc::new(sphere(points));
    let bounds = Bounds {
        min: Vec3::NEG_ONE,
        max: Vec3::ONE,
    };
    let mut orbit = Orbit::framing(&bounds, Vec3::new(0.2, 0.3, 1.0), Vec3::NEG_Y);
    let mut view = SceneView::new(device, queue);
    let draw = |view: &mut SceneView, orbit: &Orbit| {
        let begun = Instant::now();
        let camera = orbit.camera(SIZE.0, SIZE.1);
        let whole = view.draw(&Scene3d {
            camera,
            style: SceneStyle::default(),
            lines: Vec::new(),
            planes: Vec::new(),
            over: None,
        });
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        (whole, begun.elapsed())
    };
    let begun = Instant::now();
    view.set_model(SceneModel::Cloud(cloud));
    while view.drawn().0 == 0 {
        draw(&mut view, &orbit);
    }
    let first = begun.elapsed();
    let (mut slowest, mut calls) = (Duration::ZERO, 1);
    while let (false, took) = draw(&mut view, &orbit) {
        // Calls that only wait for the points to be arranged take no time.
        calls += usize::from(took > Duration::from_millis(1));
        slowest = slowest.max(took);
        std::thread::yield_now();
    }
    println!(
        "{:.1} M points: first image {:.0} ms; all arranged, uploaded and drawn {:.2} s in {calls} calls, the slowest \
         {:.0} ms; peak memory {}",
        points as f64 / 1e6,
        first.as_secs_f64() * 1e3,
        begun.elapsed().as_secs_f64(),
        slowest.as_secs_f64() * 1e3,
        peak_memory().map_or("unknown".into(), |bytes| format!("{:.2} GB", bytes / 1e9))
    );
    for (what, closer) in [("whole", 1.0), ("near by", 0.23)] {
        orbit.distance *= closer;
        let begun = Instant::now();
        let mut drawn = 0;
        for _ in 0..MOVES {
            orbit.turn(TAU / MOVES as f32);
            draw(&mut view, &orbit);
            drawn += view.drawn().0;
        }
        let moving = begun.elapsed();
        let begun = Instant::now();
        while !draw(&mut view, &orbit).0 {}
        println!(
            "  {what}: moving {:.1} pictures/s of {:.2} M points; at rest {:.2} M points after {:.0} ms",
            MOVES as f64 / moving.as_secs_f64(),
            drawn as f64 / MOVES as f64 / 1e6,
            view.drawn().0 as f64 / 1e6,
            begun.elapsed().as_secs_f64() * 1e3
        );
    }
}

/// Returns the peak memory of the process in bytes, if the system reports it.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? * 1024.0)
}

fn sphere(points: usize) -> LabelledCloud {
    let at = |i: usize| {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / points as f32;
        let (s, c) = (i as f32 * 2.399_963).sin_cos();
        Vec3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z)
    };
    LabelledCloud::from_positions((0..points).map(at).collect())
}
