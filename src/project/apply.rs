use std::path::{Component, Path};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use glam::DVec3;

use crate::{Edit, FrameMask, Marks, MaskOrigin, Project, ResultKind, ResultRecord};
use ostra_frames::{DepthCamera, DepthSource, Frame, FrameCamera};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{Label, LabelId, Prompt};

impl Project {
    /// Applies an edit and returns its exact inverse.
    ///
    /// A rejected edit leaves the project unchanged.
    ///
    /// # Errors
    ///
    /// Returns an error if the edit would break an invariant. Examples are a frame or label that
    /// does not exist, a mask whose size differs from its frame's, a stale keyframe, a label that
    /// is still in use, and a non-finite number.
    pub fn apply(&mut self, edit: Edit) -> Result<Edit> {
        match edit {
            Edit::SetLabel { id, label } => self.set_label(id, label),
            Edit::SetPrompt {
                frame,
                label,
                prompt,
            } => self.set_prompt(frame, label, prompt),
            Edit::SetMask { frame, mask } => self.set_mask(frame, mask),
            Edit::SetMarks { label, marks } => self.set_marks(label, marks),
            Edit::SetStale { frames, stale } => Ok(self.set_stale(&frames, stale)),
            Edit::SetOrigin { origin } => self.set_origin(origin),
            Edit::SetCamera { frame, camera } => self.set_camera(frame, camera),
            Edit::SetDepth { frame, depth } => self.set_depth(frame, depth),
            Edit::AddFrames { frames } => self.add_frames(frames),
            Edit::DropFrames { keep } => self.drop_frames(keep),
            Edit::SetFrame { frame, value } => self.set_frame(frame, *value),
            Edit::SetResult { kind, record } => self.set_result(kind, record),
        }
    }

    /// Returns the frame with this number.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such frame. The message gives the valid range.
    pub fn frame(&self, number: usize) -> Result<&Frame> {
        self.frames
            .get(number)
            .with_context(|| match self.frames.len() {
                0 => format!("there is no frame {number}: the project has no frames"),
                count => format!(
                    "there is no frame {number}; the project has frames 0 to {}",
                    count - 1
                ),
            })
    }

    fn set_label(&mut self, id: LabelId, label: Option<Label>) -> Result<Edit> {
        let before = self.labels.get(id).cloned();
        match label {
            Some(label) => {
                ensure!(
                    label.id == id,
                    "label {} cannot be stored as label {}",
                    label.id.0,
                    id.0
                );
                self.labels.set(label)?;
            }
            None => {
                let name = before.as_ref().map_or("", |label| label.name.as_str());
                ensure!(
                    !self.is_in_use(id),
                    "label '{name}' is still used by prompts, masks or marks; take these off first"
                );
                self.labels.remove(id)?;
            }
        }
        Ok(Edit::SetLabel { id, label: before })
    }

    fn is_in_use(&self, id: LabelId) -> bool {
        self.marks.contains_key(&id)
            || self.prompts.keys().any(|&(_, label)| label == id)
            || self
                .masks
                .values()
                .any(|mask| mask.runs.runs.iter().any(|&(run, _)| run == id))
    }

    fn set_prompt(&mut self, frame: usize, label: LabelId, prompt: Option<Prompt>) -> Result<Edit> {
        self.frame(frame)?;
        ensure!(
            self.labels.get(label).is_some(),
            "there is no label {}; make it first",
            label.0
        );
        if let Some(prompt) = &prompt {
            ensure!(
                !prompt.is_empty(),
                "an empty prompt is taken out, not stored"
            );
            let points = prompt.clicks.iter().map(|click| click.at_px);
            let corners = prompt.boxes.iter().flat_map(|b| [b.min_px, b.max_px]);
            let finite = points.chain(corners).all(glam::DVec2::is_finite);
            ensure!(
                finite,
                "a click or box on frame {frame} is not a finite number; give it again"
            );
        }
        let key = (frame, label);
        let before = match prompt {
            Some(prompt) => self.prompts.insert(key, prompt),
            None => self.prompts.remove(&key),
        };
        Ok(Edit::SetPrompt {
            frame,
            label,
            prompt: before,
        })
    }

    fn set_marks(&mut self, label: LabelId, marks: Marks) -> Result<Edit> {
        ensure!(
            self.labels.get(label).is_some(),
            "there is no label {}; make it first",
            label.0
        );
        marks
            .last()
            .map_or(Ok(()), |last| self.frame(last).map(drop))?;
        let before = if marks.is_empty() {
            self.marks.remove(&label)
        } else {
            self.marks.insert(label, marks)
        };
        Ok(Edit::SetMarks {
            label,
            marks: before.unwrap_or_default(),
        })
    }

    fn set_mask(&mut self, frame: usize, mask: Option<FrameMask>) -> Result<Edit> {
        let of = self.frame(frame)?;
        if let Some(mask) = &mask {
            self.check_mask(of, mask)?;
        }
        let before = match mask {
            Some(mask) => self.masks.insert(frame, mask),
            None => self.masks.remove(&frame),
        };
        Ok(Edit::SetMask {
            frame,
            mask: before,
        })
    }

    /// Rejects a mask that does not fit its frame or the project's labels.
    pub(super) fn check_mask(&self, frame: &Frame, mask: &FrameMask) -> Result<()> {
        let (runs, name) = (&mask.runs, &frame.name);
        ensure!(
            (runs.width, runs.height) == (frame.width, frame.height),
            "{name}: the mask has {}×{} pixels, the frame {}×{}; give a mask of the frame's size",
            runs.width,
            runs.height,
            frame.width,
            frame.height
        );
        let pixels: u64 = runs.runs.iter().map(|&(_, length)| u64::from(length)).sum();
        let whole = runs.runs.iter().all(|&(_, length)| length > 0)
            && pixels == u64::from(frame.width) * u64::from(frame.height);
        ensure!(whole, "{name}: the mask's runs do not cover the frame");
        let unknown = runs
            .runs
            .iter()
            .find(|&&(id, _)| id != LabelId::NONE && self.labels.get(id).is_none());
        if let Some((id, _)) = unknown {
            bail!(
                "{name}: the mask has label {}, which the project does not have; make it first",
                id.0
            );
        }
        ensure!(
            !(mask.stale && mask.origin == MaskOrigin::Keyframe),
            "{name}: a keyframe is never stale"
        );
        let confidence = mask
            .confidence
            .values()
            .all(|share| (0.0..=1.0).contains(share));
        ensure!(confidence, "{name}: a confidence lies outside 0 to 1");
        Ok(())
    }

    fn set_stale(&mut self, frames: &[usize], stale: bool) -> Edit {
        let mut changed = Vec::new();
        for &frame in frames {
            let Some(mask) = self.masks.get_mut(&frame) else {
                continue;
            };
            if mask.origin == MaskOrigin::Tracked && mask.stale != stale {
                mask.stale = stale;
                changed.push(frame);
            }
        }
        Edit::SetStale {
            frames: changed,
            stale: !stale,
        }
    }

    fn set_origin(&mut self, origin: DVec3) -> Result<Edit> {
        ensure!(
            origin.is_finite(),
            "the origin of the coordinates is not finite"
        );
        Ok(Edit::SetOrigin {
            origin: std::mem::replace(&mut self.origin, origin),
        })
    }

    fn set_camera(&mut self, frame: usize, camera: Option<FrameCamera>) -> Result<Edit> {
        let of = self.frame(frame)?;
        if let Some(camera) = &camera {
            check_camera(of, camera)?;
        }
        let place = &mut Arc::make_mut(&mut self.frames)[frame].camera;
        Ok(Edit::SetCamera {
            frame,
            camera: std::mem::replace(place, camera),
        })
    }

    fn set_depth(&mut self, frame: usize, depth: Option<DepthSource>) -> Result<Edit> {
        let name = &self.frame(frame)?.name;
        if let Some(depth) = &depth {
            check_depth(name, depth)?;
        }
        let place = &mut Arc::make_mut(&mut self.frames)[frame].depth;
        Ok(Edit::SetDepth {
            frame,
            depth: std::mem::replace(place, depth),
        })
    }

    fn add_frames(&mut self, frames: Vec<Frame>) -> Result<Edit> {
        let mut names: std::collections::BTreeSet<&str> = self
            .frames
            .iter()
            .map(|frame| frame.name.as_str())
            .collect();
        for frame in &frames {
            check_frame(frame)?;
            ensure!(
                names.insert(&frame.name),
                "there is already a frame '{}'; leave it out",
                frame.name
            );
        }
        let keep = self.frames.len();
        Arc::make_mut(&mut self.frames).extend(frames);
        Ok(Edit::DropFrames { keep })
    }

    fn drop_frames(&mut self, keep: usize) -> Result<Edit> {
        ensure!(
            keep <= self.frames.len(),
            "there are only {} frames",
            self.frames.len()
        );
        let used = self.masks.range(keep..).next().is_some()
            || self.prompts.keys().any(|&(frame, _)| frame >= keep)
            || self
                .marks
                .values()
                .any(|marks| marks.last().is_some_and(|last| last >= keep));
        ensure!(
            !used,
            "frames from {keep} on still have masks, prompts or marks; take these off first"
        );
        let frames = Arc::make_mut(&mut self.frames).split_off(keep);
        Ok(Edit::AddFrames { frames })
    }

    fn set_frame(&mut self, frame: usize, value: Frame) -> Result<Edit> {
        let before = self.frame(frame)?;
        check_frame(&value)?;
        ensure!(
            value.name == before.name,
            "frame {frame} is '{}' and keeps its name",
            before.name
        );
        let same_size = (value.width, value.height) == (before.width, before.height);
        ensure!(
            same_size || !self.masks.contains_key(&frame),
            "{}: the image has {}×{} pixels, its mask {}×{}; give the image that the mask was made on",
            value.name,
            value.width,
            value.height,
            before.width,
            before.height
        );
        let before = std::mem::replace(&mut Arc::make_mut(&mut self.frames)[frame], value);
        Ok(Edit::SetFrame {
            frame,
            value: Box::new(before),
        })
    }

    fn set_result(&mut self, kind: ResultKind, record: Option<ResultRecord>) -> Result<Edit> {
        let before = match record {
            Some(record) => {
                ensure!(
                    record.seconds.is_finite(),
                    "the time of a result is not a finite number"
                );
                self.results.insert(kind, record)
            }
            None => self.results.remove(&kind),
        };
        Ok(Edit::SetResult {
            kind,
            record: before,
        })
    }
}

/// Rejects a frame that the project cannot hold.
///
/// A frame's name becomes the path of its mask file, so it must stay below the project's folder.
fn check_frame(frame: &Frame) -> Result<()> {
    let name = &frame.name;
    let inside = Path::new(name)
        .components()
        .all(|part| matches!(part, Component::Normal(_)));
    let plain = inside
        && !name.is_empty()
        && !name.contains(['\\', '\n', '\r', '\0'])
        && !name.ends_with('/');
    ensure!(
        plain,
        "'{name}' cannot be the name of a frame; rename the file"
    );
    ensure!(
        frame.width > 0 && frame.height > 0,
        "{name}: the image has no pixels"
    );
    frame
        .depth
        .as_ref()
        .map_or(Ok(()), |depth| check_depth(name, depth))?;
    if let ostra_frames::ImageSource::Video { time_s, .. } = frame.image {
        ensure!(
            time_s.is_finite(),
            "{name}: its time in the video is not a finite number"
        );
    }
    frame
        .camera
        .as_ref()
        .map_or(Ok(()), |camera| check_camera(frame, camera))
}

fn check_depth(name: &str, depth: &DepthSource) -> Result<()> {
    let (DepthSource::Sensor { unit, .. } | DepthSource::Estimated { scale: unit, .. }) = depth;
    ensure!(
        unit.is_finite() && *unit > 0.0,
        "{name}: the depth unit must be a number above 0"
    );
    match depth {
        DepthSource::Estimated { made, .. } => {
            // Only the project's own folders are known to contain no link that leads elsewhere.
            let is_own = made
                .components()
                .all(|part| matches!(part, Component::Normal(_)))
                && ["versions", "depths"]
                    .iter()
                    .any(|own| made.starts_with(own));
            ensure!(
                is_own,
                "{name}: {}: its depth map must lie among those of the project",
                made.display()
            );
        }
        DepthSource::Sensor { camera, .. } => {
            let finite = |camera: &DepthCamera| {
                is_finite(&camera.intrinsics, Some(&camera.image_from_depth))
            };
            let what =
                "the camera of its depth has a value that is not a finite number; give it again";
            ensure!(camera.as_deref().is_none_or(finite), "{name}: {what}");
        }
    }
    Ok(())
}

/// Rejects cameras that could be written to the journal but not read back.
fn check_camera(frame: &Frame, camera: &FrameCamera) -> Result<()> {
    let (name, intrinsics) = (&frame.name, &camera.intrinsics);
    let finite = is_finite(intrinsics, camera.camera_from_world.as_ref());
    ensure!(
        finite,
        "{name}: its camera has a value that is not a finite number; repair the camera file"
    );
    ensure!(
        (intrinsics.width, intrinsics.height) == (frame.width, frame.height),
        "{name}: its camera is for {} × {} pixels but the image has {} × {}; give the camera of this image",
        intrinsics.width,
        intrinsics.height,
        frame.width,
        frame.height
    );
    Ok(())
}

fn is_finite(camera: &Camera, pose: Option<&Pose>) -> bool {
    serde_json::to_value(camera).is_ok_and(|value| !has_null(&value))
        && pose.is_none_or(|pose| pose.rotation.is_finite() && pose.translation.is_finite())
}

/// Returns whether a JSON value contains `null`, which is how non-finite numbers are written.
fn has_null(value: &serde_json::Value) -> bool {
    match value {
        serde_json::Value::Null => true,
        serde_json::Value::Array(items) => items.iter().any(has_null),
        serde_json::Value::Object(fields) => fields.values().any(has_null),
        _ => false,
    }
}
