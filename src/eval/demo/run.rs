use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use glam::DVec3;

use super::report::{
    CloudReport, DemoReport, LevelsReport, MaskReport, score_levels, separate_instances,
};
use super::user::{DemoDriver, ProgressSink, SimulatedUser};
use super::workspace;
use crate::cloud_score::{CloudScoreOptions, score_cloud};
use crate::synthetic::{Scene, SceneOptions, SyntheticView, TruthOptions};
use ostra_cloud::LabelledCloud;
use ostra_cloud::ply::{SavedColors, read_mesh, read_ply, save_mesh, save_ply};
use ostra_core::disk;
use ostra_core::job::Progress;
use ostra_frames::cameras::IntrinsicsSource;
use ostra_frames::{Frame, FrameFolder, OpenRequest};
use ostra_geometry::{Alignment, Camera, Similarity};
use ostra_masks::LabelMask;
use ostra_project::{ExportRequest, FuseRequest, ReconstructMethod, ReconstructRequest};
use ostra_session::{AttachRequest, Command, NewProject, Session};

/// Options of the demo.
#[derive(Debug, Clone, PartialEq)]
pub struct DemoOptions {
    /// Output folder of everything that the demo makes.
    ///
    /// It contains `recording/`, `project/`, `truth/`, `cloud.ply`, `mesh.ply` and `report.json`.
    pub out: PathBuf,
    /// The synthetic scene.
    pub scene: SceneOptions,
    /// Source of cameras and depths.
    pub method: DemoMethod,
}

/// Source of the demo's cameras and depths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DemoMethod {
    /// The exact cameras and the depths of a synthetic sensor.
    Given,
    /// The images alone: structure from motion, then stereo.
    ///
    /// The cloud is aligned to the ground truth by a Sim(3) of the camera centres.
    Stereo,
    /// Poses from the images and the depths of a synthetic sensor.
    ///
    /// The cloud is aligned to the ground truth by an SE(3) of the camera centres.
    Rgbd,
}

impl DemoMethod {
    /// Returns the reconstruction method and the alignment to the ground truth, if any.
    fn reconstruction(self) -> Option<(ReconstructMethod, Alignment)> {
        match self {
            Self::Given => None,
            Self::Stereo => Some((ReconstructMethod::Mvs, Alignment::Sim3)),
            Self::Rgbd => Some((ReconstructMethod::Rgbd, Alignment::Se3)),
        }
    }
}

/// Maximum number of clicks per class on the first frame.
const FIRST_CLICKS: usize = 7;
/// Maximum number of clicks per class on each corrected frame.
const CORRECTING_CLICKS: usize = 1;

/// Distance in metres beyond which a ground truth point counts as not reconstructed.
const WITHIN_M: f64 = 0.003;

/// Runs the complete workflow on a synthetic scene and scores the results.
///
/// It writes the recording, creates a project and clicks as a simulated user (at most
/// [`super::MAX_CLICKS`] per label). Then it tracks the masks with the geometry tracker, fuses,
/// exports, and scores against the exact ground truth. The project stays open in `session`.
///
/// # Errors
/// Returns an error if `out` cannot be written or holds other files, or if a stage fails or is
/// stopped.
pub fn run_demo(
    session: &mut Session,
    options: &DemoOptions,
    watch: &mut ProgressSink<'_>,
) -> Result<DemoReport> {
    let mut clock = Clock::default();
    let out = &options.out;
    let _claim = workspace::prepare(out)?;
    let scene = Scene::build(&options.scene)?;
    let truth_cloud = clock.time("1 scene", || make_recording(&scene, out))?;
    let mut demo = Demo {
        options,
        scene: &scene,
        separated: scene.classes_with_instances(),
        studio: DemoDriver::new(session, watch),
        clock,
    };
    demo.open()?;
    let user = demo.label()?;
    demo.fuse()?;
    let cloud_path = demo.export()?;
    let (cloud, levels) = demo.clock.time("8 score", || {
        score(&truth_cloud, &cloud_path, &demo.separated)
    })?;
    let report = DemoReport {
        cloud,
        levels,
        masks: MaskReport {
            iou: user.mean_ious(&demo.studio)?,
        },
        clicks: user.clicks(),
        seconds: demo.clock.seconds,
        scene: describe(&options.scene),
    };
    let json = serde_json::to_string_pretty(&report)?;
    write(&out.join("report.json"), json.as_bytes())?;
    Ok(report)
}

/// A demo in progress.
struct Demo<'a, 's, 'w> {
    options: &'a DemoOptions,
    scene: &'a Scene,
    /// Classes that are clicked as one and split into instances.
    separated: Vec<String>,
    studio: DemoDriver<'s, 'w>,
    clock: Clock,
}

impl Demo<'_, '_, '_> {
    /// Runs a command as a stage or part of one.
    fn act(&mut self, stage: &str, command: Command) -> Result<()> {
        self.clock.time(stage, || self.studio.act(command))
    }

    /// Creates the project and, depending on the method, reconstructs cameras and depths.
    fn open(&mut self) -> Result<()> {
        let method = self.options.method;
        self.clock.time("2 open", || {
            self.studio.act(Command::New(new_project(
                &self.options.out,
                method,
                self.scene.views(),
            )))
        })?;
        if let Some((method, _)) = method.reconstruction() {
            let request = ReconstructRequest {
                method,
                ..ReconstructRequest::default()
            };
            self.act("3 reconstruct", Command::Reconstruct(request))?;
        }
        Ok(())
    }

    /// Clicks as a simulated user and tracks the masks until no click helps.
    fn label(&mut self) -> Result<SimulatedUser> {
        let views = self.scene.views().iter();
        let truth_masks: Vec<LabelMask> = views
            .map(|view| self.scene.render_exact(view).mask)
            .collect();
        let mut user = SimulatedUser::new(
            &mut self.studio,
            truth_masks,
            self.scene.tree(),
            &self.scene.clicked_labels(),
            &self.separated,
        )?;
        let first = user.clearest_frame();
        self.clock.time("4 click", || {
            user.click_on(&mut self.studio, first, FIRST_CLICKS)
        })?;
        self.track()?;
        while let Some(frame) = user.worst_frame(&self.studio)? {
            let before = user.clicks();
            self.clock.time("4 click", || {
                user.click_on(&mut self.studio, frame, CORRECTING_CLICKS)
            })?;
            if user.clicks() == before {
                break;
            }
            self.track()?;
        }
        Ok(user)
    }

    fn track(&mut self) -> Result<()> {
        self.clock
            .time("5 track", || SimulatedUser::track(&mut self.studio))
    }

    /// Fuses the frames, corrects the masks by the cloud, and fuses again.
    fn fuse(&mut self) -> Result<()> {
        self.studio.session.release_memory();
        self.act("6 fuse", Command::Fuse(FuseRequest::default()))?;
        if self
            .studio
            .session
            .votes()
            .is_some_and(|votes| votes.has_voters())
        {
            self.act("6 adopt", Command::Attach(AttachRequest::default()))?;
        }
        if !self.separated.is_empty() {
            self.clock.time("6 instances", || {
                separate_instances(&mut self.studio, &self.separated)
            })?;
        }
        self.studio.session.release_memory();
        let request = FuseRequest {
            drop_unlabelled: true,
            ..FuseRequest::default()
        };
        self.act("6 fuse", Command::Fuse(request))
    }

    /// Exports the cloud and, if there is one, the surface, aligned to the ground truth.
    ///
    /// Returns the path of the cloud.
    fn export(&mut self) -> Result<PathBuf> {
        let out = &self.options.out;
        let cloud_path = out.join("cloud.ply");
        let voxel = self.studio.session.surface_voxel();
        let mesh_path = voxel.map(|_| out.join("mesh.ply"));
        let export = ExportRequest {
            cloud: Some(cloud_path.clone()),
            mesh: mesh_path.clone(),
            ..ExportRequest::default()
        };
        self.act("7 export", Command::Export(export))?;
        if let Some((_, alignment)) = self.options.method.reconstruction() {
            let project = self.studio.session.project();
            let project = project.context("no project is open")?;
            align(
                [Some(&cloud_path), mesh_path.as_ref()],
                &project.frames,
                self.scene.views(),
                alignment,
            )?;
        }
        Ok(cloud_path)
    }
}

/// Wall time by stage; the times of a repeated stage are added.
#[derive(Default)]
struct Clock {
    seconds: BTreeMap<String, f64>,
}

impl Clock {
    fn time<T>(&mut self, stage: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let begun = Instant::now();
        let result = work();
        *self.seconds.entry(stage.to_owned()).or_default() += begun.elapsed().as_secs_f64();
        result
    }
}

fn make_recording(scene: &Scene, out: &Path) -> Result<LabelledCloud> {
    let progress = Progress::default();
    let recording = out.join("recording");
    scene.write(&recording, &progress)?;
    let truth = out.join("truth");
    std::fs::rename(recording.join("truth"), &truth)
        .with_context(|| format!("{}: cannot be written", truth.display()))?;
    let cloud = scene.cloud(
        &TruthOptions {
            surroundings_m: None,
            ..TruthOptions::default()
        },
        &progress,
    )?;
    save_ply(
        &truth.join("cloud.ply"),
        &cloud,
        SavedColors::Image,
        &progress,
    )?;
    Ok(cloud)
}

pub(super) fn new_project(out: &Path, method: DemoMethod, views: &[SyntheticView]) -> NewProject {
    let recording = out.join("recording");
    let given = |path: &str, given: bool| given.then(|| recording.join(path));
    let depth = given("depth", method != DemoMethod::Stereo);
    let source = FrameFolder {
        frames: recording.join("color"),
        depth,
    };
    // The recording of a depth camera includes its intrinsics, but no poses.
    let camera = views
        .first()
        .filter(|_| method == DemoMethod::Rgbd)
        .map(|view| view.camera);
    NewProject {
        root: out.join("project"),
        open: OpenRequest {
            sources: vec![source],
            depth_unit: Scene::DEPTH_UNIT_M,
            ..OpenRequest::default()
        },
        cameras: given("sparse", method == DemoMethod::Given),
        intrinsics: camera.map(
            |Camera {
                 focal_px,
                 principal_px,
                 ..
             }| {
                IntrinsicsSource::Values([focal_px.x, focal_px.y, principal_px.x, principal_px.y])
            },
        ),
    }
}

/// Aligns the cloud and the mesh in these files to the ground truth by the camera centres.
fn align(
    [cloud, mesh]: [Option<&PathBuf>; 2],
    frames: &[Frame],
    views: &[SyntheticView],
    alignment: Alignment,
) -> Result<()> {
    let pairs = frames.iter().zip(views).filter_map(|(frame, view)| {
        let (_, found) = frame.posed_camera()?;
        Some((found.centre(), view.camera_from_world.centre()))
    });
    let (found, truth): (Vec<DVec3>, Vec<DVec3>) = pairs.unzip();
    let to_truth = Similarity::align(&found, &truth, alignment)?;
    let progress = Progress::default();
    if let Some(path) = cloud {
        let mut cloud = read_ply(path, &progress)?.cloud;
        transform(&mut cloud, &to_truth);
        save_ply(path, &cloud, SavedColors::Image, &progress)?;
    }
    if let Some(path) = mesh {
        let mut mesh = read_mesh(path, &progress)?;
        transform(&mut mesh.vertices, &to_truth);
        save_mesh(path, &mesh, SavedColors::Image, &progress)?;
    }
    Ok(())
}

fn transform(cloud: &mut LabelledCloud, by: &Similarity) {
    for position in &mut cloud.positions {
        *position = by.transform(position.as_dvec3()).as_vec3();
    }
    for normal in &mut cloud.normals {
        *normal = (by.rotation * normal.as_dvec3()).as_vec3();
    }
}

fn score(
    truth: &LabelledCloud,
    cloud_path: &Path,
    separated: &[String],
) -> Result<(CloudReport, Option<LevelsReport>)> {
    let progress = Progress::default();
    let result = read_ply(cloud_path, &progress)?.cloud;
    let level = Some(Scene::CLASS_LEVEL);
    let options = CloudScoreOptions {
        within: vec![WITHIN_M],
        level,
        ..CloudScoreOptions::default()
    };
    let score = score_cloud(truth, &result, &options, &progress)?;
    let mut parts = BTreeMap::new();
    for (name, of_part) in parts_of(truth) {
        let labels = score_cloud(&of_part, &result, &options, &progress)?.labels;
        parts.insert(name, labels.accuracy);
    }
    let has_levels = !separated.is_empty();
    let levels = has_levels
        .then(|| score_levels(truth, &result, separated, WITHIN_M))
        .transpose()?;
    let cloud = CloudReport {
        iou: score
            .labels
            .iou
            .iter()
            .map(|label| (label.name.clone(), label.iou))
            .collect(),
        parts,
        accuracy: score.labels.accuracy,
        median_distance_mm: score.median_distance * 1000.0,
        points: result.len(),
    };
    Ok((cloud, levels))
}

/// Groups the points by the last word of their part's name: `sheath` for `leaf 3 sheath`.
fn parts_of(truth: &LabelledCloud) -> BTreeMap<String, LabelledCloud> {
    let mut indices: BTreeMap<String, Vec<u32>> = BTreeMap::new();
    for (at, &id) in truth.labels.iter().enumerate() {
        let is_part = truth.tree.depth(id) > Scene::CLASS_LEVEL;
        let name = truth
            .tree
            .get(id)
            .and_then(|label| label.name.rsplit(' ').next());
        if let Some(kind) = name.filter(|kind| is_part && kind.parse::<usize>().is_err()) {
            indices.entry(kind.to_owned()).or_default().push(at as u32);
        }
    }
    indices
        .into_iter()
        .map(|(kind, indices)| (kind, truth.select(&indices)))
        .collect()
}

fn describe(scene: &SceneOptions) -> String {
    format!(
        "{:?}, {} views of {}x{}, seed {}",
        scene.scene, scene.views, scene.width, scene.height, scene.seed
    )
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    disk::write(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}
