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
    /// Clicks given, per class, over the whole sequence.
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

/// The masks' score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaskReport {
    /// Mean IoU over the frames, per class.
    pub iou: BTreeMap<String, f64>,
}

impl DemoReport {
    /// The report as a table for people.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text =
            format!("{}\n\n{:<14} {:>9} {:>9} {:>7}\n", self.scene, "label", "mask IoU", "3-D IoU", "clicks");
        for (class, iou) in &self.cloud.iou {
            let mask = self.masks.iou.get(class).copied().unwrap_or(0.0);
            let clicks = self.clicks.get(class).copied().unwrap_or(0);
            let _ = writeln!(text, "{class:<14} {mask:>9.4} {iou:>9.4} {clicks:>7}");
        }
        for (part, share) in &self.cloud.parts {
            let _ = writeln!(text, "{:<14} {:>9} {share:>9.4}  (share labelled right)", format!("  {part}"), "");
        }
        let cloud = &self.cloud;
        let _ = writeln!(text, "\naccuracy over labelled truth points  {:.4}", cloud.accuracy);
        let _ = writeln!(text, "median distance to truth             {:.2} mm", cloud.median_distance_mm);
        let _ = writeln!(text, "points                               {}\n", cloud.points);
        for (stage, seconds) in &self.seconds {
            let _ = writeln!(text, "{stage:<14} {seconds:>8.1} s");
        }
        text
    }
}
