use anyhow::{Result, bail};

use super::drive::Driver;
use super::mask_args::{GroundArgs, MasksArgs, MasksVerb, PromptArgs, TidyArgs, TraceArgs};
use super::print::say;
use super::project::label_id;
use ostra_masks::{Click, Prompt, PxBox};
use ostra_session::{
    Command, GroundRequest, PromptRequest, TakeRequest, TidyRequest, TraceRequest,
};

pub(super) fn prompt(args: &PromptArgs) -> Result<()> {
    let driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let click = |include| move |&at_px| Click { at_px, include };
    let clicks = args
        .click
        .iter()
        .map(click(true))
        .chain(args.not.iter().map(click(false)))
        .collect();
    let boxes = args
        .boxes
        .iter()
        .map(|&[min_px, max_px]| PxBox { min_px, max_px })
        .collect();
    let request = PromptRequest {
        frame: args.frame,
        label,
        prompt: Prompt {
            clicks,
            boxes,
            ..Prompt::default()
        },
        segmenter: args.segmenter.clone(),
    };
    driver.act_and_save([Command::Prompt(request)])
}

pub(super) fn ground(args: &GroundArgs) -> Result<()> {
    let mut driver = Driver::open(&args.project)?;
    let phrases = args.text.split(';').map(|phrase| phrase.trim().to_owned());
    let phrases: Vec<String> = phrases.filter(|phrase| !phrase.is_empty()).collect();
    let (frame, threshold) = (args.frame, Some(args.threshold));
    driver.act(Command::Ground(GroundRequest {
        frame,
        phrases,
        threshold,
        grounder: args.grounder.clone(),
    }))?;
    let found = driver.found();
    if found.is_empty() {
        bail!(
            "nothing of '{}' was found on frame {frame}; try a lower --threshold, another frame, or other words",
            args.text
        );
    }
    for thing in &found {
        let PxBox { min_px, max_px } = thing.extent;
        let extent = format!(
            "{:.0},{:.0},{:.0},{:.0}",
            min_px.x, min_px.y, max_px.x, max_px.y
        );
        say(&format!(
            "{}: {:.0} %, {extent}\n",
            thing.phrase,
            100.0 * thing.score
        ));
    }
    let things = found
        .into_iter()
        .map(|thing| (thing.phrase, thing.extent))
        .collect();
    driver.act_and_save([Command::TakeFound(TakeRequest {
        frame,
        things,
        segmenter: args.segmenter.clone(),
    })])
}

pub(super) fn masks(args: MasksArgs) -> Result<()> {
    let (dir, format, overwrite) = (args.dir, args.format, args.overwrite);
    match args.verb {
        MasksVerb::Import => {
            Driver::open(&args.project)?.act_and_save([Command::ImportMasks { dir, format }])
        }
        MasksVerb::Export => Driver::view(&args.project)?.act_and_save([Command::ExportMasks {
            dir,
            format,
            overwrite,
        }]),
    }
}

pub(super) fn trace(args: TraceArgs) -> Result<()> {
    let driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let request = TraceRequest {
        frame: args.frame,
        label,
        points_px: args.point,
        replace: args.replace,
    };
    driver.act_and_save([Command::Trace(request)])
}

pub(super) fn tidy(args: &TidyArgs) -> Result<()> {
    let driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let (holes_below_px, islands_below_px) = (args.holes_below, args.islands_below);
    driver.act_and_save([Command::Tidy(TidyRequest {
        frame: args.frame,
        label,
        holes_below_px,
        islands_below_px,
    })])
}
