use super::*;
use crate::engine::job::Progress;

#[test]
fn look() {
    let Ok(out) = std::env::var("LOOK") else { return };
    let kind = if std::env::var("BRICKS").is_ok() { SceneKind::Bricks } else { SceneKind::Tiller };
    let seed = std::env::var("SEED").map_or(1, |s| s.parse().unwrap());
    let noise = std::env::var("NOISE").is_ok().then(SensorNoise::default);
    let t = std::time::Instant::now();
    let scene = Scene::build(&SceneOptions { scene: kind, seed, noise, ..SceneOptions::default() }).unwrap();
    eprintln!("build {:?}", t.elapsed());
    let t = std::time::Instant::now();
    scene.write(std::path::Path::new(&out), &Progress::default()).unwrap();
    eprintln!("write {:?}", t.elapsed());
    let t = std::time::Instant::now();
    for view in scene.views() {
        scene.render(view);
    }
    eprintln!("render {:?}", t.elapsed());
    let t = std::time::Instant::now();
    let cloud = scene.cloud(&TruthOptions::default(), &Progress::default()).unwrap();
    eprintln!("cloud {:?} {}", t.elapsed(), cloud.len());
    let mut n = std::collections::BTreeMap::new();
    for &l in &cloud.labels {
        *n.entry(scene.tree().at_level(l, 2)).or_insert(0) += 1;
    }
    eprintln!("{n:?}");
}
