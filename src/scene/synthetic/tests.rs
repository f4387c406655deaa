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
        let _ = scene.render(view);
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

#[test]
fn inside() {
    for seed in 1..12 {
        let scene = Scene::build(&SceneOptions { seed, ..SceneOptions::default() }).unwrap();
        let cloud = scene
            .cloud(&TruthOptions { spacing_m: 0.003, surroundings_m: None, min_views: 0 }, &Progress::default())
            .unwrap();
        let mut worst = 0.0f64;
        let mut top = f64::MAX;
        for v in scene.views() {
            let mut out = 0;
            for x in &cloud.positions {
                let p = v.camera.project(v.camera_from_world.transform(x.as_dvec3())).unwrap();
                top = top.min(p.y);
                if p.x < 0. || p.y < 0. || p.x > 480. || p.y > 640. {
                    out += 1;
                }
            }
            worst = worst.max(out as f64 / cloud.len() as f64);
        }
        let z = cloud.positions.iter().fold((1f32, 0f32), |a, p| (a.0.min(p.z), a.1.max(p.z)));
        eprintln!("{seed} out {worst:.4} top {top:.1} z {z:?} grains {}", scene.traits().last().unwrap().value);
    }
}

#[test]
fn turns() {
    let t: Vec<String> = (1..12).map(|s| format!("{:.2}", super::dice::Dice::new(s, 1).range(0.0, 6.283))).collect();
    eprintln!("{t:?}");
}
