use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

/// What `report.json` holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DemoReport {
    /// The labelled cloud against the exact one.
    pub cloud: CloudReport,
    /// The masks against the exact ones, over all frames.
    pub masks: MaskReport,
    /// The cloud at the level of classes, instances and parts, where a scene has truth for all three.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub levels: Option<LevelsReport>,
    /// Clicks given, per label that the user clicks, over the whole sequence.
    pub clicks: BTreeMap<String, usize>,
    /// Wall time of each stage.
    pub seconds: BTreeMap<String, f64>,
    /// What was made, so that it can be made again.
    pub scene: String,
}

/// A cloud's score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CloudReport {
    /// IoU per class over all truth points.
    pub iou: BTreeMap<String, f64>,
    /// Share of each named part's points that got the class's label, where parts are told apart (sheaths).
    pub parts: BTreeMap<String, f64>,
    /// Share of the labelled truth points that got the right class.
    pub accuracy: f64,
    /// Median distance from a labelled truth point to the nearest point of the result.
    pub median_distance_mm: f64,
    /// Number of points made.
    pub points: usize,
}

/// IoU of a cloud's labels over all truth points, level by level of the label tree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LevelsReport {
    /// Per class.
    pub class: BTreeMap<String, f64>,
    /// Per instance; those told apart by themselves under the name of the true one that they stand for.
    pub instance: BTreeMap<String, f64>,
    /// Per part.
    pub part: BTreeMap<String, f64>,
    /// Instances that were found of each class that was labelled as one.
    pub instances: BTreeMap<String, usize>,
}

/// The masks' score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaskReport {
    /// Mean IoU over the frames, per label that the user clicks.
    pub iou: BTreeMap<String, f64>,
}

impl DemoReport {
    /// The report as a table for people.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "{}\n\n{:<20} {:>9} {:>9} {:>7}\n",
            self.scene, "label", "mask IoU", "3-D IoU", "clicks"
        );
        match &self.levels {
            None => self
                .cloud
                .iou
                .iter()
                .for_each(|(label, &iou)| self.row(&mut text, label, iou)),
            Some(levels) => {
                for (title, ious) in [
                    ("class", &levels.class),
                    ("instance", &levels.instance),
                    ("part", &levels.part),
                ] {
                    let _ = writeln!(text, "{title}");
                    ious.iter()
                        .for_each(|(label, &iou)| self.row(&mut text, label, iou));
                }
                for (class, count) in &levels.instances {
                    let _ = writeln!(text, "instances of {class} found: {count}");
                }
            }
        }
        for (part, share) in &self.cloud.parts {
            let _ = writeln!(
                text,
                "{:<20} {:>9} {share:>9.4}  (share labelled right)",
                format!("  {part}"),
                ""
            );
        }
        let cloud = &self.cloud;
        let _ = writeln!(
            text,
            "\naccuracy over labelled truth points  {:.4}",
            cloud.accuracy
        );
        let _ = writeln!(
            text,
            "median distance to truth             {:.2} mm",
            cloud.median_distance_mm
        );
        let _ = writeln!(
            text,
            "points                               {}\n",
            cloud.points
        );
        for (stage, seconds) in &self.seconds {
            let _ = writeln!(text, "{stage:<14} {seconds:>8.1} s");
        }
        text
    }

    /// Mask IoU and clicks are known of labels that were clicked.
    fn row(&self, text: &mut String, label: &str, iou: f64) {
        let mask = self
            .masks
            .iou
            .get(label)
            .map_or_else(String::new, |iou| format!("{iou:.4}"));
        let clicks = self
            .clicks
            .get(label)
            .map_or_else(String::new, usize::to_string);
        let _ = writeln!(text, "{label:<20} {mask:>9} {iou:>9.4} {clicks:>7}");
    }
}
