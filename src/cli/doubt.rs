use anyhow::{Result, ensure};
use serde_json::json;

use super::args::DoubtArgs;
use super::drive::Driver;
use super::print::{say, say_json};
use super::project::label_id;
use ostra_cloud::doubt::FrameDoubt;
use ostra_masks::LabelId;
use ostra_session::Command;

/// Lists the frames whose masks the vote contradicts, or accepts the vote on some.
pub(super) fn doubt(args: &DoubtArgs) -> Result<()> {
    let is_change = !args.accept.is_empty();
    let mut driver = if is_change {
        Driver::open(&args.project)?
    } else {
        Driver::view(&args.project)?
    };
    if is_change {
        let labels: Vec<LabelId> = args
            .label
            .iter()
            .map(|name| label_id(driver.project()?, name))
            .collect::<Result<_>>()?;
        let accept = |&frame: &usize| Command::AcceptVote {
            frame,
            labels: labels.clone(),
        };
        return driver.act_and_save(args.accept.iter().map(accept));
    }
    let doubts = driver.doubts()?;
    ensure!(
        !doubts.is_empty(),
        "it is not known which pixels voted on this cloud; fuse again with masks and cameras"
    );
    let mut ranked: Vec<_> = doubts.iter().collect();
    ranked.sort_by(|a, b| b.1.share().total_cmp(&a.1.share()).then(a.0.cmp(b.0)));
    let frames = &driver.project()?.frames;
    if args.json {
        let row = |(&frame, doubt): (&usize, &FrameDoubt)| {
            json!({ "frame": frame, "name": frames[frame].name, "share": doubt.share(), "against": doubt.against,
                "compared": doubt.compared })
        };
        say_json(&json!({ "frames": ranked.into_iter().map(row).collect::<Vec<_>>() }));
        return Ok(());
    }
    say("contradicted   of pixels  frame\n");
    for (&frame, doubt) in ranked {
        let share = 100.0 * doubt.share();
        say(&format!(
            "{share:>10.2} % {:>11}  {frame} {}\n",
            doubt.compared, frames[frame].name
        ));
    }
    Ok(())
}
