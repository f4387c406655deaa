//! Valid ranges of the numbers in a command.
//!
//! Recipes are files from unknown sources, so every number is checked.

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};

use crate::command::{Command, NewProject};
use crate::requests::{PaintRequest, TrackSettings};
use ostra_cloud::measure::GroundChoice;
use ostra_cloud::select::{Eye, SeenRegion, SelectStep};
use ostra_frames::cameras::IntrinsicsSource;
use ostra_masks::PxBox;
use ostra_project::{
    ExportRequest, FuseRequest, Project, RangeChange, ReconstructRequest, ScaleEnd, ScaleRequest,
};

/// Maximum distance in pixels of a position outside its frame.
///
/// A stroke may leave the image, and in a window that shows the image small, the pointer can be far
/// away from it.
const MAX_OUTSIDE_PX: f64 = 100_000.0;
/// Maximum number of positions in one command.
const MAX_POSITIONS: usize = 1_000_000;
/// Maximum brush radius in pixels.
const MAX_RADIUS_PX: f64 = 100_000.0;
/// Maximum width and height of the view in which points are selected, in pixels.
const MAX_EYE_SIDE_PX: u32 = 16_384;
/// Maximum of coordinates and lengths in world units.
///
/// Beyond it, a double cannot represent millimetres.
const MAX_WORLD: f64 = 1e12;
/// Range of the step of a depth image, in world units.
const DEPTH_UNITS: [f64; 2] = [1e-12, 1e6];
/// Range of the shorter image side for networks, in pixels, as on the command line.
const SHORT_SIDES: std::ops::RangeInclusive<u32> = 64..=4096;
/// Range of the longer image side for stereo, in pixels, as on the command line.
const MAX_SIDES: std::ops::RangeInclusive<u32> = 64..=8192;
/// Maximum size of a project's cache, in GiB, as on the command line.
const MAX_CACHE_GIB: u32 = 1024;

impl Command {
    /// Checks every number in the command before it is executed.
    ///
    /// # Errors
    ///
    /// Returns an error if a number is out of range. The message names the number and the range.
    pub(super) fn check_numbers(&self, project: Option<&Project>) -> Result<()> {
        let image = |frame: usize| Image::of(project, frame);
        match self {
            Self::New(new) | Self::AddFrames(new) => check_new(new),
            Self::Prompt(request) => {
                let image = image(request.frame)?;
                image.check(
                    "click",
                    request.prompt.clicks.iter().map(|click| click.at_px),
                )?;
                image.check("box", corners(&request.prompt.boxes))
            }
            Self::TakeFound(request) => {
                image(request.frame)?.check("box", corners(request.things.iter().map(|(_, at)| at)))
            }
            Self::Ground(request) => check_share("the least score", request.threshold),
            Self::Paint(request) => check_stroke(request, &image(request.frame)?),
            Self::MoveBorder(request) => {
                image(request.frame)?.check("position", [request.from_px, request.to_px])
            }
            Self::Trace(request) => {
                image(request.frame)?.check("point", request.points_px.iter().copied())
            }
            Self::Range(request) => match request.change {
                RangeChange::Split { frame, at_px, .. } => image(frame)?.check("position", [at_px]),
                _ => Ok(()),
            },
            Self::CorrectCloud(correction) => {
                correction.select.iter().try_for_each(|step| match step {
                    SelectStep::Seen(region) => check_seen(region, project),
                    _ => Ok(()),
                })
            }
            Self::Track(settings) => check_track(settings),
            Self::Reconstruct(request) => check_reconstruct(request, project),
            Self::Scale(request) => check_scale(request, project),
            Self::Fuse(request) => check_fuse(request),
            Self::Export(request) => check_export(request),
            _ => Ok(()),
        }
    }
}

/// The image against which positions are checked.
struct Image {
    name: String,
    width: u32,
    height: u32,
}

impl Image {
    fn of(project: Option<&Project>, number: usize) -> Result<Self> {
        let frame = project
            .context("no project is open; open one first")?
            .frame(number)?;
        Ok(Self {
            name: format!("frame {number}"),
            width: frame.width,
            height: frame.height,
        })
    }

    /// Rejects positions that are not finite or far outside the image.
    fn check(&self, what: &str, positions_px: impl IntoIterator<Item = DVec2>) -> Result<()> {
        let (last, mut count) = (DVec2::new(f64::from(self.width), f64::from(self.height)), 0);
        for at in positions_px {
            count += 1;
            ensure!(
                count <= MAX_POSITIONS,
                "a command may hold {MAX_POSITIONS} positions, this one holds more"
            );
            let outside = (-at).max(at - last).max_element();
            ensure!(
                at.is_finite() && outside <= MAX_OUTSIDE_PX,
                "{what} {count} at {}, {} is too far outside {} ({}x{}); at most {MAX_OUTSIDE_PX} pixels are possible",
                at.x,
                at.y,
                self.name,
                self.width,
                self.height
            );
        }
        Ok(())
    }
}

fn corners<'a>(boxes: impl IntoIterator<Item = &'a PxBox>) -> impl Iterator<Item = DVec2> {
    boxes.into_iter().flat_map(|at| [at.min_px, at.max_px])
}

fn check_radius(radius_px: f64) -> Result<()> {
    let possible = (0.0..=MAX_RADIUS_PX).contains(&radius_px);
    ensure!(
        possible,
        "a brush radius of {radius_px} pixels is not possible; give 0 to {MAX_RADIUS_PX}"
    );
    Ok(())
}

fn check_share(what: &str, share: Option<f32>) -> Result<()> {
    let possible = share.is_none_or(|share| (0.0..=1.0).contains(&share));
    ensure!(
        possible,
        "{what} must be between 0 and 1, got {}",
        share.unwrap_or_default()
    );
    Ok(())
}

fn check_new(new: &NewProject) -> Result<()> {
    let unit = new.open.depth_unit;
    let [least, most] = DEPTH_UNITS;
    ensure!(
        (least..=most).contains(&unit),
        "a depth unit of {unit} is not possible; give {least} to {most}"
    );
    if let Some(IntrinsicsSource::Values(values)) = new.intrinsics {
        let possible = values.iter().all(|value| value.abs() <= MAX_WORLD);
        ensure!(
            possible,
            "the intrinsics {values:?} are not possible; give fx, fy, cx, cy in pixels"
        );
    }
    Ok(())
}

fn check_stroke(request: &PaintRequest, image: &Image) -> Result<()> {
    check_radius(request.radius_px)?;
    image.check("point", request.points_px.iter().copied())
}

fn check_seen(region: &SeenRegion, project: Option<&Project>) -> Result<()> {
    let image = match &region.eye {
        Eye::Frame(number) => Image::of(project, *number)?,
        Eye::Free { camera, .. } => {
            let (width, height) = (camera.width, camera.height);
            ensure!(
                width.max(height) <= MAX_EYE_SIDE_PX,
                "a view of {width}x{height} pixels is too large; at most {MAX_EYE_SIDE_PX} a side are possible"
            );
            Image {
                name: "the view".into(),
                width,
                height,
            }
        }
    };
    check_radius(region.radius_px)?;
    check_share("the least confidence", region.uncertain_below)?;
    image.check("point", region.points_px.iter().copied())
}

fn check_track(settings: &TrackSettings) -> Result<()> {
    check_share("the confidence to pause below", settings.pause_below)?;
    let side = settings
        .short_side
        .filter(|side| !SHORT_SIDES.contains(side));
    let (least, most) = (SHORT_SIDES.start(), SHORT_SIDES.end());
    ensure!(
        side.is_none(),
        "a short side of {} pixels is not possible; give {least} to {most}",
        side.unwrap_or_default()
    );
    Ok(())
}

fn check_reconstruct(request: &ReconstructRequest, project: Option<&Project>) -> Result<()> {
    ensure!(
        request.every >= 1,
        "'every' must be at least 1, got 0: 1 uses each frame, 2 every second one"
    );
    let side = request.max_side.filter(|side| !MAX_SIDES.contains(side));
    let (least, most) = (MAX_SIDES.start(), MAX_SIDES.end());
    ensure!(
        side.is_none(),
        "a longer side of {} pixels is not possible; give {least} to {most}",
        side.unwrap_or_default()
    );
    ensure!(
        request.cache_limit_gib <= MAX_CACHE_GIB,
        "a cache of {} GiB is not possible; give 0 to {MAX_CACHE_GIB}",
        request.cache_limit_gib
    );
    let frames = project.map_or(0, |project| project.frames.len());
    for &[a, b] in &request.pairs {
        ensure!(
            a != b && a.max(b) < frames,
            "frames {a} and {b} are not a pair of frames; there are {frames}"
        );
    }
    Ok(())
}

fn check_scale(request: &ScaleRequest, project: Option<&Project>) -> Result<()> {
    let length = request.length;
    ensure!(
        length > 0.0 && length <= MAX_WORLD,
        "a length of {length} is not possible; give a number above 0"
    );
    request.ends.iter().try_for_each(|end| match end {
        ScaleEnd::World(at) => check_world(*at),
        ScaleEnd::Seen(seen) => seen
            .iter()
            .try_for_each(|&(frame, at_px)| Image::of(project, frame)?.check("position", [at_px])),
    })
}

fn check_world(at: DVec3) -> Result<()> {
    let possible = at.is_finite() && at.abs().max_element() <= MAX_WORLD;
    ensure!(
        possible,
        "the point {}, {}, {} is too far away; at most {MAX_WORLD} units are possible",
        at.x,
        at.y,
        at.z
    );
    Ok(())
}

fn check_fuse(request: &FuseRequest) -> Result<()> {
    check_share("the least confidence", request.min_confidence)?;
    let voxel = request
        .voxel
        .filter(|voxel| !(*voxel > 0.0 && *voxel <= MAX_WORLD));
    ensure!(
        voxel.is_none(),
        "a voxel size of {} is not possible; give a length above 0",
        voxel.unwrap_or_default()
    );
    Ok(())
}

fn check_export(request: &ExportRequest) -> Result<()> {
    let share = request
        .simplify
        .filter(|share| !(*share > 0.0 && *share <= 1.0));
    ensure!(
        share.is_none(),
        "triangles to keep must be above 0 and at most 1, got {}",
        share.unwrap_or_default()
    );
    ensure!(
        request.level != Some(0),
        "level 0 does not exist; 1 is the top of the label tree"
    );
    if let GroundChoice::Plane { normal, offset } = request.ground {
        check_world(DVec3::from_array(normal))?;
        ensure!(
            offset.abs() <= MAX_WORLD,
            "a ground plane at {offset} is not possible; give a distance in world units"
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CloudChange, CloudCorrection, MoveBorderRequest, PromptRequest, TraceRequest};
    use ostra_masks::{Click, LabelId, Prompt};
    use ostra_project::SegmenterId;
    use ostra_project::testing::project;

    const FAR: [DVec2; 4] = [
        DVec2::new(5.0, 4_294_967_296.0),
        DVec2::new(-1e13, 2.0),
        DVec2::new(f64::NAN, 1.0),
        DVec2::new(1.0, f64::INFINITY),
    ];

    fn commands_at(at_px: DVec2) -> Vec<Command> {
        let (frame, label) = (1, LabelId(1));
        let points_px = vec![DVec2::ONE, at_px];
        let prompt = |prompt| {
            Command::Prompt(PromptRequest {
                frame,
                label,
                prompt,
                segmenter: SegmenterId::Builtin,
            })
        };
        let paint = |snap| PaintRequest {
            frame,
            label,
            points_px: points_px.clone(),
            radius_px: 2.0,
            erase: false,
            replace: true,
            snap,
        };
        let seen = SeenRegion {
            eye: Eye::Frame(frame),
            points_px: points_px.clone(),
            radius_px: 1.0,
            remove: false,
            hidden: Vec::new(),
            isolated: None,
            uncertain_below: None,
            cube_from_world: None,
        };
        vec![
            prompt(Prompt {
                clicks: vec![Click {
                    at_px,
                    include: true,
                }],
                ..Prompt::default()
            }),
            prompt(Prompt {
                boxes: vec![PxBox {
                    min_px: DVec2::ZERO,
                    max_px: at_px,
                }],
                ..Prompt::default()
            }),
            Command::Paint(paint(false)),
            Command::Paint(paint(true)),
            Command::MoveBorder(MoveBorderRequest {
                frame,
                label,
                from_px: DVec2::ONE,
                to_px: at_px,
                replace: true,
            }),
            Command::Trace(TraceRequest {
                frame,
                label,
                points_px: points_px.clone(),
                replace: true,
            }),
            Command::Scale(ScaleRequest {
                ends: [
                    ScaleEnd::World(DVec3::ZERO),
                    ScaleEnd::Seen(vec![(frame, at_px)]),
                ],
                length: 1.0,
            }),
            Command::CorrectCloud(CloudCorrection {
                select: vec![SelectStep::Seen(seen)],
                change: CloudChange::Clear,
                as_keyframes: false,
            }),
        ]
    }

    #[test]
    fn positions_far_outside_the_frame_are_rejected() {
        let project = project();
        for command in commands_at(DVec2::new(-3.0, 900.0)) {
            command.check_numbers(Some(&project)).unwrap();
        }
        for at_px in FAR {
            for command in commands_at(at_px) {
                let error = command
                    .check_numbers(Some(&project))
                    .unwrap_err()
                    .to_string();
                assert!(error.contains("frame 1 (4x3)"), "{command:?}: {error}");
            }
        }
    }

    #[test]
    fn numbers_out_of_range_are_rejected_with_the_range() {
        let track = |short_side| {
            Command::Track(TrackSettings {
                short_side: Some(short_side),
                ..Default::default()
            })
        };
        let reconstruct = |every, max_side| {
            Command::Reconstruct(ReconstructRequest {
                every,
                max_side: Some(max_side),
                ..Default::default()
            })
        };
        let cached = |cache_limit_gib| {
            Command::Reconstruct(ReconstructRequest {
                cache_limit_gib,
                ..Default::default()
            })
        };
        let fuse = |voxel| {
            Command::Fuse(FuseRequest {
                voxel: Some(voxel),
                ..Default::default()
            })
        };
        let export = |simplify| {
            Command::Export(ExportRequest {
                simplify: Some(simplify),
                ..Default::default()
            })
        };
        let project = project();
        let check = |command: Command| command.check_numbers(Some(&project));
        for sound in [track(480), reconstruct(1, 1024), fuse(0.001), export(0.5)] {
            check(sound).unwrap();
        }
        for (broken, range) in [
            (track(u32::MAX), "64 to 4096"),
            (reconstruct(1, u32::MAX), "64 to 8192"),
            (reconstruct(0, 1024), "at least 1"),
            (cached(1025), "0 to 1024"),
            (fuse(0.0), "above 0"),
            (fuse(f64::NAN), "above 0"),
            (export(7.0), "at most 1"),
        ] {
            let error = check(broken.clone()).unwrap_err().to_string();
            assert!(error.contains(range), "{broken:?}: {error}");
        }
    }
}
