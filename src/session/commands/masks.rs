use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, ensure};

use crate::Session;
use crate::{JobCompletion, JobKind};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_masks::{Imported, MaskFormat, MaskFrame, RunMask, file_stems};
use ostra_project::export_targets::ExportTargets;
use ostra_project::mask_edits::keyframe_of;
use ostra_project::{Edit, Project};

impl Session {
    pub(crate) fn import_masks(&mut self, dir: &Path, format: MaskFormat) -> Result<JobId> {
        let (project, dir) = (self.snapshot()?, dir.to_owned());
        Ok(self.start("Import masks", JobKind::Short, move |context| {
            let imported = format.import_masks(
                &dir,
                &mask_frames(&project),
                &project.labels,
                &context.progress,
            )?;
            Ok(Box::new(move |session: &mut Self| session.take_masks(imported)) as JobCompletion)
        }))
    }

    /// Commits imported masks; their frames become keyframes.
    fn take_masks(&mut self, imported: Imported) -> Result<()> {
        let Imported {
            masks,
            new_labels,
            warnings,
        } = imported;
        let title = format!("Import {} masks", masks.len());
        let labels = new_labels.into_iter().map(|label| Edit::SetLabel {
            id: label.id,
            label: Some(label),
        });
        let project = self.snapshot()?;
        let masks = masks.into_iter().map(|(frame, runs)| {
            let runs = project.with_locks(frame, Arc::new(runs));
            Edit::SetMask {
                frame,
                mask: Some(keyframe_of(runs)),
            }
        });
        let masks: Vec<Edit> = masks.collect();
        let again = project.there_again(&masks);
        self.commit(&title, labels.chain(masks).chain(again).collect())?;
        self.warn_all(warnings);
        Ok(())
    }

    pub(crate) fn export_masks(
        &mut self,
        dir: &Path,
        format: MaskFormat,
        overwrite: bool,
    ) -> Result<JobId> {
        let (project, dir) = (self.snapshot()?, dir.to_owned());
        ensure!(
            !project.masks.is_empty(),
            "no frame has a mask; prompt, paint or track first"
        );
        let targets = ExportTargets::of(&project, self.root(), overwrite);
        targets.check_folder(&dir)?;
        Ok(self.start("Export masks", JobKind::Short, move |context| {
            let write = || write(&dir, format, &project, None, &context.progress);
            let ((), warnings) = ExportTargets::write_all(&[], std::slice::from_ref(&dir), write)?;
            Ok(Box::new(|session: &mut Self| {
                session.warn_all(warnings);
                Ok(())
            }) as JobCompletion)
        }))
    }
}

/// Writes all masks of a project.
///
/// With `level`, deeper labels are replaced by their ancestor at this level.
pub fn write(
    folder: &Path,
    format: MaskFormat,
    project: &Project,
    level: Option<usize>,
    progress: &Progress,
) -> Result<()> {
    let at_level = |runs: Arc<RunMask>| match level {
        Some(level) => Arc::new(runs.at_level(&project.labels, level)),
        None => runs,
    };
    let masks = project
        .masks_in_play()
        .map(|(frame, runs)| (frame, at_level(runs)));
    Ok(format.export_masks(
        folder,
        &mask_frames(project),
        masks,
        &project.labels,
        progress,
    )?)
}

/// Returns for each frame a relative path without extension for its file in an export folder.
pub fn stems(project: &Project) -> Result<Vec<String>> {
    Ok(file_stems(&mask_frames(project))?)
}

fn mask_frames(project: &Project) -> Vec<MaskFrame<'_>> {
    project.frames.iter().map(MaskFrame::from).collect()
}
