use anyhow::Result;

use super::args::InstancesArgs;
use super::drive::Driver;
use super::print::say;
use super::project::label_id;
use ostra_cloud::instances::InstanceOptions;
use ostra_masks::LabelId;
use ostra_session::{Command, InstancesRequest};

/// Tells the instances of a class apart and names each with its number of points.
pub(super) fn instances(args: &InstancesArgs) -> Result<()> {
    let mut driver = Driver::open(&args.project)?;
    let label = label_id(driver.project()?, &args.label)?;
    let before: Vec<LabelId> = driver.project()?.labels.descendants(label);
    let options = InstanceOptions {
        radius: args.radius,
        min_points: args.min_points,
        ..InstanceOptions::default()
    };
    driver.act(Command::Instances(InstancesRequest { label, options }))?;
    let (cloud, tree) = (driver.cloud()?, driver.project()?.labels.clone());
    for made in tree
        .descendants(label)
        .into_iter()
        .filter(|id| !before.contains(id))
    {
        let points = cloud.labels.iter().filter(|&&id| id == made).count();
        let name = tree.get(made).map_or("", |label| &label.name);
        say(&format!("{name:<24} {points:>9} points\n"));
    }
    driver.act_and_save([])
}
