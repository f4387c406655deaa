mod sizes;
mod votes;

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

use super::*;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameCamera, Image, ImageSource, Orientation};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{Label, LabelId, LabelMask, LabelTree};

const WIDTH: u32 = 80;
const HEIGHT: u32 = 60;
const BALL: LabelId = LabelId(2);
const WALL: LabelId = LabelId(1);

/// A ball of radius 0.3 at the origin in front of a wall at z = 1.
///
/// The depths are exact, from several sides.
#[derive(Clone, Default)]
struct Scene {
    frames: Vec<Frame>,
    images: Vec<Arc<Image>>,
    depths: Vec<Option<Arc<DepthMap>>>,
    masks: Vec<Option<Arc<LabelMask>>>,
}

impl Views for Scene {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }
    fn has_depth(&self, index: usize) -> bool {
        self.depths[index].is_some()
    }
    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        Ok(self.images[index].clone())
    }
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(self.depths[index].clone())
    }
    fn mask(&self, index: usize) -> Option<Arc<LabelMask>> {
        self.masks[index].clone()
    }
}

impl Scene {
    fn new(views: usize) -> Self {
        let mut scene = Self::default();
        for view in 0..views {
            let side = view as f64 / views as f64 - 0.5;
            scene.add(DVec3::new(2.0 * side, 0.3 * side, -2.0));
        }
        scene
    }

    fn add(&mut self, eye: DVec3) {
        let forward = -eye.normalize();
        let right = DVec3::Y.cross(forward).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        let pose = Pose::from_matrix(rotation, rotation * -eye).unwrap();
        let camera = Camera::pinhole(WIDTH, HEIGHT, [80.0, 80.0], [40.0, 30.0]);
        let (mut depths, mut ids, mut pixels) = (Vec::new(), Vec::new(), Vec::new());
        for index in 0..WIDTH * HEIGHT {
            let at = DVec2::new(
                f64::from(index % WIDTH) + 0.5,
                f64::from(index / WIDTH) + 0.5,
            );
            let ray = pose.rotation.conjugate() * camera.unproject(at).extend(1.0);
            let (depth, id) = cast(eye, ray);
            depths.push(depth as f32);
            ids.push(id);
            pixels.push(if id == BALL {
                [200, 10, 10]
            } else {
                [10, 10, 200]
            });
        }
        let frame = Frame {
            name: format!("{:03}", self.frames.len()),
            width: WIDTH,
            height: HEIGHT,
            image: ImageSource::File {
                path: "none".into(),
                orientation: Orientation(1),
            },
            depth: None,
            camera: Some(FrameCamera::given(camera, Some(pose))),
        };
        self.frames.push(frame);
        self.images.push(Arc::new(Image {
            width: WIDTH,
            height: HEIGHT,
            pixels,
        }));
        self.depths.push(Some(Arc::new(DepthMap {
            width: WIDTH,
            height: HEIGHT,
            depths,
        })));
        self.masks.push(Some(Arc::new(LabelMask {
            width: WIDTH,
            height: HEIGHT,
            ids,
        })));
    }

    fn reordered(&self, order: &[usize]) -> Self {
        Self {
            frames: order.iter().map(|&i| self.frames[i].clone()).collect(),
            images: order.iter().map(|&i| self.images[i].clone()).collect(),
            depths: order.iter().map(|&i| self.depths[i].clone()).collect(),
            masks: order.iter().map(|&i| self.masks[i].clone()).collect(),
        }
    }

    fn fused(&self, options: &FuseOptions) -> Fused {
        fuse(self, &tree(), options, &Progress::default()).unwrap()
    }
}

/// Returns the depth and the label of what a ray hits.
///
/// The depth is along the optical axis, and the ray has length 1 along it.
fn cast(eye: DVec3, ray: DVec3) -> (f64, LabelId) {
    let (a, b, c) = (
        ray.length_squared(),
        eye.dot(ray),
        eye.length_squared() - 0.09,
    );
    let root = b * b - a * c;
    if root > 0.0 {
        ((-b - root.sqrt()) / a, BALL)
    } else {
        ((1.0 - eye.z) / ray.z, WALL)
    }
}

fn tree() -> LabelTree {
    let mut tree = LabelTree::default();
    for (id, name) in [(WALL, "wall"), (BALL, "ball")] {
        tree.set(Label {
            id,
            name: name.into(),
            color: [id.0 as u8; 3],
            parent: None,
        })
        .unwrap();
    }
    tree
}

fn options() -> FuseOptions {
    FuseOptions {
        voxel: Some(0.03),
        ..FuseOptions::default()
    }
}

fn is_ball(cloud: &LabelledCloud, point: usize) -> bool {
    cloud.positions[point].length() < 0.5
}

#[test]
fn fused_labels_colors_normals_and_positions_are_correct() {
    let fused = Scene::new(7).fused(&options());
    let cloud = &fused.cloud;
    let right = (0..cloud.len())
        .filter(|&p| cloud.labels[p] == if is_ball(cloud, p) { BALL } else { WALL })
        .count();
    assert!(
        right as f64 > 0.998 * cloud.len() as f64,
        "{right} of {}",
        cloud.len()
    );
    let balls: Vec<usize> = (0..cloud.len()).filter(|&p| is_ball(cloud, p)).collect();
    let off = balls
        .iter()
        .map(|&p| (cloud.positions[p].length() - 0.3).abs())
        .fold(0.0, f32::max);
    assert!(
        balls.len() > 300 && off < 0.012,
        "{} points, {off}",
        balls.len()
    );
    let straight = balls
        .iter()
        .filter(|&&p| cloud.normals[p].dot(cloud.positions[p].normalize()) > 0.9)
        .count();
    assert!(
        straight as f64 > 0.9 * balls.len() as f64,
        "{straight} of {}",
        balls.len()
    );
    assert!(
        balls
            .iter()
            .filter(|&&p| cloud.colors[p] == [200, 10, 10])
            .count() as f64
            > 0.95 * balls.len() as f64
    );
    assert_eq!(fused.report.frames_fused, 7);
    assert_eq!(fused.report.pixels, 7 * 4800);
    assert_eq!(fused.report.labels.values().sum::<usize>(), cloud.len());
}

#[test]
fn fusion_gives_only_labels_of_masks() {
    let mut scene = Scene::new(5);
    for mask in &mut scene.masks {
        let ids = mask
            .as_ref()
            .unwrap()
            .ids
            .iter()
            .map(|&id| if id == BALL { LabelId(40) } else { LabelId(10) })
            .collect();
        *mask = Some(Arc::new(LabelMask {
            width: WIDTH,
            height: HEIGHT,
            ids,
        }));
    }
    let fused = scene.fused(&options());
    assert!(
        fused
            .cloud
            .labels
            .iter()
            .all(|id| [0, 10, 40].contains(&id.0))
    );
    assert_eq!(fused.cloud.tree.get(LabelId(40)).unwrap().name, "40");
}

#[test]
fn result_does_not_depend_on_thread_count() {
    let scene = Scene::new(4);
    let pool = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
    };
    let one = pool(1).install(|| scene.fused(&options()));
    let five = pool(5).install(|| scene.fused(&options()));
    assert!(one == five);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn result_does_not_depend_on_view_order(order in Just((0..5).collect::<Vec<usize>>()).prop_shuffle()) {
        let scene = Scene::new(5);
        let (straight, shuffled) = (scene.fused(&options()), scene.reordered(&order).fused(&options()));
        prop_assert!(straight.cloud == shuffled.cloud);
        for point in 0..straight.votes.len() {
            prop_assert_eq!(straight.votes.histogram(point), shuffled.votes.histogram(point));
        }
    }

    #[test]
    fn relabelling_equals_fusing_again(seed in any::<u64>(), changed in prop::collection::btree_set(0usize..5, 0..5), removed in any::<bool>()) {
        let mut scene = Scene::new(5);
        scene.masks[3] = None;
        let before = scene.fused(&options());
        let mut changes = Vec::new();
        for &frame in &changed {
            let id = |i: u64| LabelId((seed.rotate_left((i % 64) as u32).wrapping_mul(i / 300 + 1) % 7) as u16);
            let ids = (0..u64::from(WIDTH * HEIGHT)).map(id).collect();
            let mask = (frame != 1 || !removed).then(|| Arc::new(LabelMask { width: WIDTH, height: HEIGHT, ids }));
            scene.masks[frame].clone_from(&mask);
            changes.push(ChangedMask { frame, mask });
        }
        let fresh = scene.fused(&options());
        let (cloud, votes) = relabel(&before.cloud, &before.votes, &changes, &tree(), &Progress::default()).unwrap();
        prop_assert!(cloud == fresh.cloud);
        prop_assert!(votes == fresh.votes);
        let again = vote_again(&before.cloud, &before.votes, &scene, &tree(), &Progress::default()).unwrap();
        prop_assert!(again.cloud == fresh.cloud);
        prop_assert!(again.votes == fresh.votes);
        prop_assert_eq!(again.report.frames_voted, fresh.report.frames_voted);
    }
}

#[test]
fn voters_are_the_pixels_that_see_a_point() {
    let scene = Scene::new(6);
    let fused = scene.fused(&FuseOptions {
        drop_unlabelled: true,
        ..options()
    });
    for point in (0..fused.cloud.len()).step_by(97) {
        let voters = fused.votes.voters(point);
        assert_eq!(
            voters.len(),
            fused
                .votes
                .histogram(point)
                .iter()
                .map(|&(_, n)| usize::from(n))
                .sum::<usize>()
        );
        for voter in voters {
            let (camera, pose) = scene.frames[voter.frame].posed_camera().unwrap();
            let at = camera
                .project(pose.transform(fused.cloud.positions[point].as_dvec3()))
                .unwrap();
            assert!(
                (at - DVec2::new(f64::from(voter.x) + 0.5, f64::from(voter.y) + 0.5))
                    .abs()
                    .max_element()
                    < 1.51
            );
            assert_eq!(
                voter.label,
                Some(
                    scene.masks[voter.frame]
                        .as_ref()
                        .unwrap()
                        .at(voter.x, voter.y)
                )
            );
        }
    }
}

#[test]
fn dropped_points_are_counted_by_reason() {
    let mut scene = Scene::new(5);
    for mask in &mut scene.masks {
        let ids = mask
            .as_ref()
            .unwrap()
            .ids
            .iter()
            .map(|&id| if id == BALL { BALL } else { LabelId::NONE })
            .collect();
        *mask = Some(Arc::new(LabelMask {
            width: WIDTH,
            height: HEIGHT,
            ids,
        }));
    }
    let all = scene.fused(&options());
    let kept = scene.fused(&FuseOptions {
        drop_unlabelled: true,
        ..options()
    });
    assert!(kept.cloud.labels.iter().all(|&id| id == BALL));
    assert_eq!(kept.report.dropped.contour, 0);
    assert_eq!(
        kept.cloud.len() + kept.report.dropped.background,
        all.cloud.len()
    );
    assert_eq!(kept.votes.len(), kept.cloud.len());
    scene.masks[2] = Some(Arc::new(LabelMask::empty(WIDTH, HEIGHT)));
    let confidence = scene.fused(&FuseOptions {
        min_confidence: 0.9,
        ..options()
    });
    assert!(confidence.report.unsure > 0);
    assert!(
        (0..confidence.cloud.len()).all(|p| confidence.cloud.labels[p] == LabelId::NONE
            || confidence.cloud.confidence[p] >= 0.9)
    );
    let clean = scene.fused(&FuseOptions {
        min_confidence: 0.9,
        drop_unlabelled: true,
        ..options()
    });
    let Dropped {
        background,
        contour,
        ..
    } = clean.report.dropped;
    let voted = |point: &usize| {
        confidence
            .votes
            .histogram(*point)
            .iter()
            .any(|&(id, _)| id == BALL)
    };
    let lost = (0..confidence.cloud.len()).filter(|&point| confidence.cloud.labels[point] != BALL);
    let (contours, backgrounds): (Vec<usize>, Vec<usize>) = lost.partition(voted);
    assert_eq!((background, contour), (backgrounds.len(), contours.len()));
    assert!(contour > 0 && background > 0, "{background} {contour}");
    let twice = scene.fused(&FuseOptions {
        min_views: 3,
        ..options()
    });
    assert_eq!(
        twice.cloud.len() + twice.report.dropped.few_views,
        all.cloud.len()
    );
}

#[test]
fn flying_pixels_give_no_points() {
    let mut scene = Scene::new(3);
    let mut depth = (**scene.depths[0].as_ref().unwrap()).clone();
    depth.depths[30 * WIDTH as usize + 5] = 0.9;
    scene.depths[0] = Some(Arc::new(depth));
    let fused = scene.fused(&options());
    assert!(fused.report.dropped.flying_pixels >= 1);
    let kept = scene.fused(&FuseOptions {
        edge_tolerance: 1.0,
        ..options()
    });
    assert!(kept.cloud.len() > fused.cloud.len());
}

#[test]
fn pairs_beyond_the_budget_are_dropped_without_changing_labels() {
    let scene = Scene::new(3);
    let (full, thin) = (
        scene.fused(&options()),
        scene.fused(&FuseOptions {
            pair_budget_bytes: 100,
            ..options()
        }),
    );
    assert_eq!(full.cloud, thin.cloud);
    assert!(
        !thin.votes.has_voters()
            && thin.votes.voters(0).is_empty()
            && thin.report.warnings.len() == 1
    );
    let refused = relabel(&thin.cloud, &thin.votes, &[], &tree(), &Progress::default());
    assert!(refused.unwrap_err().to_string().contains("not kept"));
}

#[test]
fn unusable_frames_are_named_and_invalid_input_is_an_error() {
    let mut scene = Scene::new(4);
    scene.frames[1].camera = None;
    scene.depths[2] = None;
    let fused = scene.fused(&options());
    assert_eq!(
        fused.report.warnings,
        [
            "1 frame has no camera and is left out: 001",
            "1 frame has no depth and gives no points: 002"
        ]
    );
    assert_eq!(
        (fused.report.frames_fused, fused.report.frames_voted),
        (2, 3)
    );
    let refusal = |scene: &Scene, options: &FuseOptions| {
        fuse(scene, &tree(), options, &Progress::default())
            .unwrap_err()
            .to_string()
    };
    assert!(
        refusal(
            &scene,
            &FuseOptions {
                voxel: Some(-1.0),
                ..options()
            }
        )
        .contains("voxel size")
    );
    assert!(
        refusal(
            &scene,
            &FuseOptions {
                min_confidence: 1.5,
                ..options()
            }
        )
        .contains("between 0 and 1")
    );
    let mut small = scene.clone();
    small.masks[3] = Some(Arc::new(LabelMask::empty(3, 3)));
    assert!(refusal(&small, &options()).contains("frame '003': its mask is 3x3"));
    assert!(refusal(&Scene::default(), &options()).contains("no frame has both"));
    let stopped = Progress::default();
    stopped.stop();
    assert!(matches!(
        fuse(&scene, &tree(), &options(), &stopped),
        Err(SceneError::Stopped(_))
    ));
}
