use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};

use crate::engine::job::Progress;
use crate::frames::FrameStore;
use crate::masks::Label;
use crate::scene::fuse::{FuseOptions, Fused, OntoOptions, ProjectViews, Votes, fuse, vote_onto, write_votes};
use crate::scene::ply::{Coloring, read_ply, save_ply};
use crate::session::jobs::{Kind, Landing};
use crate::session::store::{cloud_path, sync_folder, votes_path};
use crate::session::{Edit, Event, FuseRequest, JobId, Project, ResultKind, ResultRecord, Session};

impl Session {
    pub(in crate::session) fn fuse(&mut self, request: &FuseRequest) -> Result<JobId> {
        self.check_no_long_job()?;
        let (project, request) = (self.snapshot()?, request.clone());
        let version = self.opened()?.next_version()?;
        let root = self.opened()?.root().to_owned();
        let store = Arc::clone(&self.store);
        Ok(self.start("Fuse", Kind::Long, move |link| {
            let begun = Instant::now();
            let fused = make(&store, &project, &request, &link.progress)?;
            link.progress.stage("save")?;
            save_ply(&cloud_path(&root, version), &fused.cloud, Coloring::Picture, &link.progress)?;
            save_votes(&votes_path(&root, version), &fused.votes)?;
            sync_folder(&root.join("versions"))?;
            let record = ResultRecord {
                engine: if request.onto.is_some() { "onto".into() } else { "fuse".into() },
                frames: fused.report.frames_voted,
                seconds: begun.elapsed().as_secs_f64(),
                stale: false,
                settings: settings(&request, &fused),
                version,
            };
            Ok(Box::new(move |session: &mut Self| session.take_cloud(&project, fused, record)) as Landing)
        }))
    }

    fn take_cloud(&mut self, made_from: &Project, fused: Fused, mut record: ResultRecord) -> Result<()> {
        let version = record.version;
        record.stale = has_changed(made_from, &*self.snapshot()?);
        self.commit("Fuse", vec![Edit::SetResult { kind: ResultKind::Cloud, record: Some(record) }])?;
        self.cloud.put(Some(version), fused.cloud, Some(fused.votes));
        self.events.push(Event::CloudChanged);
        self.warn_all(fused.report.warnings);
        Ok(())
    }
}

fn make(store: &FrameStore, project: &Project, request: &FuseRequest, progress: &Progress) -> Result<Fused> {
    let masks = |frame: usize| project.mask_in_play(frame).map(|runs| Arc::new(runs.decode()));
    let views = ProjectViews { frames: &project.frames, store, masks: &masks };
    let min_confidence = request.min_confidence.unwrap_or(0.0);
    let Some(onto) = &request.onto else {
        let options = FuseOptions {
            voxel: request.voxel,
            min_confidence,
            drop_unlabelled: request.drop_unlabelled,
            ..FuseOptions::default()
        };
        return Ok(fuse(&views, &project.labels, &options, progress)?);
    };
    let given = read_ply(onto, progress)?;
    let options = OntoOptions { min_confidence, drop_unlabelled: request.drop_unlabelled, ..OntoOptions::default() };
    let mut fused = vote_onto(&given.cloud, &views, &project.labels, &options, progress)?;
    fused.report.warnings.splice(0..0, given.warnings);
    Ok(fused)
}

/// Whether what a cloud is made of is no longer what it was.
fn has_changed(before: &Project, now: &Project) -> bool {
    let runs = |project: &Project| -> Vec<_> { project.masks_in_play().collect() };
    let same_name = |label: &Label| {
        let now = now.labels.get(label.id);
        now.is_some_and(|now| (&now.name, now.parent) == (&label.name, label.parent))
    };
    before.frames != now.frames || !before.labels.iter().all(same_name) || runs(before) != runs(now)
}

fn settings(request: &FuseRequest, fused: &Fused) -> String {
    let source = match &request.onto {
        Some(onto) => format!("onto {}", onto.display()),
        None => format!("voxel {:.6}", fused.report.voxel),
    };
    let confidence = request.min_confidence.map(|share| format!(", min confidence {share}")).unwrap_or_default();
    let dropped = if request.drop_unlabelled { ", unlabelled dropped" } else { "" };
    format!("{source}{confidence}{dropped}, {} points", fused.report.points)
}

fn save_votes(path: &Path, votes: &Votes) -> Result<()> {
    let write = || -> std::io::Result<()> {
        let mut out = BufWriter::new(File::create(path)?);
        write_votes(&mut out, votes)?;
        out.flush()?;
        out.get_ref().sync_all()
    };
    write().with_context(|| format!("{}: cannot be written; check permissions and free space", path.display()))
}
