use std::fmt::Write;

use super::cloud::CloudScore;

/// A text table; the first column is aligned left, the others right.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TextTable {
    rows: Vec<Vec<String>>,
}

impl TextTable {
    /// Appends a row; rows may differ in length.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// Returns the table as lines without trailing spaces, each with a line break.
    #[must_use]
    pub fn text(&self) -> String {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let cell_width = |column: usize| {
            self.rows
                .iter()
                .filter_map(|row| row.get(column))
                .map(|cell| cell.chars().count())
                .max()
                .unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(cell_width).collect();
        let mut text = String::new();
        for row in &self.rows {
            let mut line = String::new();
            for (column, cell) in row.iter().enumerate() {
                let width = widths[column];
                let _ = match column {
                    0 => write!(line, "{cell:<width$}"),
                    _ => write!(line, "  {cell:>width$}"),
                };
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

/// Returns the score of a cloud as text: labels, surface, confusion.
#[must_use]
pub fn cloud_table(score: &CloudScore) -> String {
    let mut labels = TextTable::default();
    labels.row(["label", "IoU", "points"]);
    for label in &score.labels.iou {
        labels.row([
            label.name.clone(),
            format!("{:.4}", label.iou),
            label.points.to_string(),
        ]);
    }
    labels.row([
        "mean".to_string(),
        format!("{:.4}", score.labels.mean_iou),
        score.truth_points.to_string(),
    ]);
    let mut shares = TextTable::default();
    shares.row([
        "accuracy".to_string(),
        format!("{:.4}", score.labels.accuracy),
    ]);
    shares.row([
        "matched".to_string(),
        format!("{:.4}", score.labels.matched),
    ]);
    shares.row([
        "median distance".to_string(),
        format!("{:.6}", score.median_distance),
    ]);
    if let Some(pairs) = score.compared_in_depth {
        shares.row(["compared in depth".to_string(), pairs.to_string()]);
    }
    let mut text = format!("{}\n{}", labels.text(), shares.text());
    if !score.surface.is_empty() {
        let mut surface = TextTable::default();
        surface.row(["within", "completeness", "accuracy", "F", "in depth"]);
        for at in &score.surface {
            let shares =
                [at.completeness, at.accuracy, at.f_score].map(|share| format!("{share:.4}"));
            let in_depth = at
                .in_depth
                .map_or("–".into(), |share| format!("{share:.4}"));
            surface.row(
                std::iter::once(at.within.to_string())
                    .chain(shares)
                    .chain([in_depth]),
            );
        }
        text = format!("{text}\n{}", surface.text());
    }
    format!("{text}\n{}", confusion_text(score))
}

fn confusion_text(score: &CloudScore) -> String {
    let confusion = &score.labels.confusion;
    let mut table = TextTable::default();
    table
        .row(std::iter::once("truth \\ result").chain(confusion.result.iter().map(String::as_str)));
    for (name, counts) in confusion.truth.iter().zip(&confusion.counts) {
        table.row(std::iter::once(name.clone()).chain(counts.iter().map(usize::to_string)));
    }
    table.text()
}
