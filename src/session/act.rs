use anyhow::Result;

use crate::{Command, Session};
use ostra_core::job::JobId;
use ostra_project::OpenProject;

impl Session {
    /// Executes a command.
    ///
    /// Quick work is done immediately. Other work is done in a job, whose end [`Session::poll`]
    /// reports.
    ///
    /// # Errors
    ///
    /// Returns an error if the command cannot be executed. Nothing has changed then.
    pub fn act(&mut self, command: Command) -> Result<Option<JobId>> {
        command.check_numbers(self.project().map(AsRef::as_ref))?;
        let begun = self.begin(&command)?;
        if begun.is_some() {
            self.record_begun(&command);
        }
        match begun.and_then(|id| self.jobs.get_mut(id)) {
            Some(job) => {
                job.command.get_or_insert(command);
            }
            None => self.record(Some(command)),
        }
        Ok(begun)
    }

    fn begin(&mut self, command: &Command) -> Result<Option<JobId>> {
        match command {
            Command::New(new) => self.new_project(new).map(Some),
            Command::Open(root) => self.open_project(root).map(Some),
            Command::View(root) => self.view_project(root).map(Some),
            Command::Inspect(path) => self.inspect(path).map(Some),
            Command::Close => Ok({
                self.close();
                None
            }),
            Command::AddFrames(new) => self.add_frames(new).map(Some),
            Command::Relocate { from, to } => self.relocate(from, to).map(Some),
            Command::AddLabel {
                name,
                parent,
                color,
            } => self
                .add_label(name, parent.as_deref(), *color)
                .map(|()| None),
            Command::EditLabel(label) => self.edit_label(label).map(|()| None),
            Command::RemoveLabel(id) => self.remove_label(*id).map(|()| None),
            Command::Prompt(request) => self.prompt(request),
            Command::Ground(request) => self.ground(request).map(Some),
            Command::TakeFound(request) => self.take_found(request).map(Some),
            Command::Paint(request) => self.paint(request),
            Command::MoveBorder(request) => self.pull(request).map(|()| None),
            Command::Trace(request) => self.trace(request).map(Some),
            Command::Clean(request) => self.tidy(request).map(|()| None),
            Command::MakeKeyframe { frame } => self.make_keyframe(*frame).map(|()| None),
            Command::AcceptVote { frame, labels } => self.accept_vote(*frame, labels).map(Some),
            Command::Instances(request) => self.instances(request).map(Some),
            Command::Attach(request) => self.attach(*request).map(Some),
            Command::CorrectCloud(correction) => self.correct_cloud(correction).map(Some),
            Command::MergeLabels { label, into } => self.merge_labels(*label, *into),
            Command::ClearMask { frame } => self.clear_mask(*frame).map(|()| None),
            Command::Range(request) => self.change_range(request),
            Command::ImportMasks { dir, format } => self.import_masks(dir, *format).map(Some),
            Command::ExportMasks {
                dir,
                format,
                overwrite,
            } => self.export_masks(dir, *format, *overwrite).map(Some),
            Command::Track(settings) => self.track(settings).map(Some),
            Command::Suggest => self.suggest().map(Some),
            Command::Propose { frame, segmenter } => self.propose(*frame, *segmenter).map(Some),
            Command::Reconstruct(request) => self.reconstruct(request).map(Some),
            Command::SelectModel { model } => self.select_model(*model).map(|()| None),
            Command::Scale(request) => self.scale(request).map(Some),
            Command::Fuse(request) => self.fuse(request).map(Some),
            Command::Export(request) => self.export(request).map(Some),
            Command::Model(request) => self.change_model(request).map(Some),
            Command::Undo => self.undo().map(|()| None),
            Command::Redo => self.redo().map(|()| None),
            Command::Stop => Ok({
                self.stop_all();
                None
            }),
        }
    }

    pub(crate) fn undo(&mut self) -> Result<()> {
        self.stop_preview_run();
        self.opened()?.undo()?;
        self.report_changed();
        Ok(())
    }

    pub(crate) fn redo(&mut self) -> Result<()> {
        self.opened()?.redo()?;
        self.report_changed();
        Ok(())
    }

    /// Stops the run whose step is undone, and drops its further results.
    fn stop_preview_run(&mut self) {
        let run = self.open.as_ref().and_then(OpenProject::preview_run);
        if let Some(job) = run.and_then(|run| self.jobs.get_mut(run)) {
            job.discard();
        }
    }
}
