use std::sync::Arc;

use anyhow::{Context, Result, bail};

use super::args::{ShotArgs, ShotColor};
use super::drive::Driver;
use crate::view::{Coloring, ShotOptions, shot as draw, write_png};

pub(super) fn shot(args: &ShotArgs) -> Result<()> {
    if args.model != "cloud" {
        bail!("{}: this project has no {}; draw --model cloud", args.project.display(), args.model);
    }
    let mut driver = Driver::open(&args.project)?;
    let cloud = driver.cloud()?;
    let cloud = match args.level {
        Some(level) => Arc::new(cloud.at_level(level)),
        None => cloud,
    };
    let coloring = match args.color {
        ShotColor::Rgb => Coloring::Rgb,
        ShotColor::Labels => Coloring::Label,
        ShotColor::Confidence => Coloring::Confidence,
    };
    let options = ShotOptions { coloring, ..ShotOptions::default() };
    let picture = draw(&cloud, &driver.project()?.frames, &options)?;
    write_png(&args.out, &picture).with_context(|| format!("{}: no picture was written", args.out.display()))
}
