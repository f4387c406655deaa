//! The graphics card's depths compared with the processor's.

mod edges;
mod real;
mod sizes;
mod twin;
mod wall;

use super::StereoEngine;
use crate::stereo::patchmatch::PlaneMap;
use ostra_compute::gpu::{Device, Software};

/// Returns a device with the programs.
fn card() -> StereoEngine {
    StereoEngine::on(Device::open(Software::Allowed).unwrap().into()).unwrap()
}

/// Returns the minimum share of pixels, in hundredths, that have the same depth within a thousandth.
///
/// It refers to the pixels for which the processor found a plane. A real card may round otherwise;
/// the processor itself, with products fused into sums, comes to the same depth for about 80 to 99
/// of 100 pixels, depending on texture.
fn least_equal(card: &StereoEngine) -> usize {
    match card {
        StereoEngine::Gpu(kernels) if !kernels.device.is_software() => 70,
        _ => 99,
    }
}

fn assert_equal(card: &StereoEngine, cpu: &PlaneMap, gpu: &PlaneMap, what: &str) {
    assert_eq!((cpu.width, cpu.height), (gpu.width, gpu.height), "{what}");
    let pairs = cpu
        .planes
        .iter()
        .zip(&gpu.planes)
        .filter(|(cpu, _)| cpu.inverse_depth > 0.0);
    let is_near = |cpu: f32, gpu: f32| gpu > 0.0 && (cpu / gpu - 1.0).abs() < 1e-3;
    let near = pairs
        .clone()
        .filter(|(cpu, gpu)| is_near(cpu.inverse_depth, gpu.inverse_depth))
        .count();
    let (same, all) = (
        pairs.clone().filter(|(cpu, gpu)| cpu == gpu).count(),
        pairs.count(),
    );
    println!("{what}: of {all} pixels {near} within 0.1 %, {same} to the bit");
    assert!(
        all > 200 && near * 100 >= all * least_equal(card),
        "{what}: {near} of {all}"
    );
    let (in_cpu, in_gpu) = (
        all,
        gpu.planes
            .iter()
            .filter(|plane| plane.inverse_depth > 0.0)
            .count(),
    );
    assert!(
        in_cpu.abs_diff(in_gpu) * 100 <= all * 2,
        "{what}: {in_cpu} and {in_gpu} pixels have depth"
    );
}
