use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use crate::SessionView;
use ostra_cloud::measure::{GroundChoice, LengthUnit, TraitRow};
use ostra_masks::LabelId;
use ostra_session::MeasureSettings;

/// Column of the table of traits.
pub(super) struct Column {
    pub(super) title: &'static str,
    pub(super) tip: &'static str,
    /// Names of the shown traits.
    pub(super) traits: &'static [&'static str],
    /// Whether all traits are shown, or only the first that the label has.
    pub(super) joined: bool,
    /// Tooltip for a label without the trait.
    pub(super) missing: &'static str,
}

const MISSING: &str = "Not available for this label";

const fn first(title: &'static str, tip: &'static str, traits: &'static [&'static str]) -> Column {
    Column {
        title,
        tip,
        traits,
        joined: false,
        missing: MISSING,
    }
}

const fn joined(title: &'static str, tip: &'static str, traits: &'static [&'static str]) -> Column {
    Column {
        title,
        tip,
        traits,
        joined: true,
        missing: MISSING,
    }
}

/// Columns after the label's name, from left to right.
pub(super) const COLUMNS: &[Column] = &[
    first(
        "Points",
        "Points of the label and its children",
        &["points"],
    ),
    first("Parts", "Groups of connected points", &["instances"]),
    first("Length", "Length along the centre line", &["length"]),
    first(
        "Width",
        "Mean width of a sheet, median diameter of a rod",
        &["width", "diameter"],
    ),
    first(
        "Widest",
        "Largest width or diameter, without the widest 5 %",
        &["width_max", "diameter_max"],
    ),
    first("Area", "Surface area", &["area"]),
    Column {
        missing: "The surface is open or thin, so it encloses no volume; 'Hull' is an upper bound",
        ..first(
            "Volume",
            "Volume of the solid that the surface encloses",
            &["volume"],
        )
    },
    first(
        "Hull",
        "Volume of the convex hull, which is at least that of the object",
        &["hull_volume"],
    ),
    first(
        "Height",
        "Height of the highest point above the ground",
        &["height_max"],
    ),
    first(
        "Insertion",
        "Angle between a sheet (leaf) and the rod (stem) it grows from",
        &["insertion_angle"],
    ),
    joined(
        "Oriented box",
        "Size along the principal axes",
        &["size_long", "size_middle", "size_short"],
    ),
    joined(
        "Box",
        "Size along the world axes x, y, z",
        &["box_x", "box_y", "box_z"],
    ),
];

/// State of the traits window.
#[derive(Debug, Clone, Default)]
pub struct MeasureView {
    /// Whether the window is open.
    pub open: bool,
    /// Settings of the measurement.
    pub settings: MeasureSettings,
    /// Chosen unit; `None` uses that of the scene.
    pub unit: Option<LengthUnit>,
    /// Pairs of labels whose angle is measured; either label may not be chosen yet.
    pub(super) angles: Vec<AngleChoice>,
    /// Column to sort by and whether the largest comes first; `None` for the order of the tree.
    pub(super) sorted: Option<(usize, bool)>,
    pub(super) table: Table,
}

impl MeasureView {
    /// Drops a metric unit if the scale is unknown.
    pub fn keep_valid(&mut self, session: &SessionView<'_>) {
        self.unit = self.unit.filter(|_| session.may_be_metric());
    }

    /// Multiplies the offset of the ground plane by `factor` after the scene was rescaled.
    pub fn scale_by(&mut self, factor: f64) {
        if let GroundChoice::Plane { offset, .. } = &mut self.settings.ground {
            *offset *= factor;
        }
    }

    /// Returns the label pairs of all complete angles.
    pub fn pairs(&self) -> impl Iterator<Item = [LabelId; 2]> {
        self.angles.iter().filter_map(AngleChoice::pair)
    }
}

/// Index of traits by label and name, built once per measurement.
#[derive(Debug, Clone, Default)]
pub(super) struct Table {
    rows: Option<Arc<Vec<TraitRow>>>,
    places: BTreeMap<(LabelId, Cow<'static, str>), usize>,
}

impl Table {
    /// Rebuilds the index if the traits changed.
    ///
    /// A trait of the whole label precedes that of its largest part.
    pub(super) fn follow(&mut self, rows: &Arc<Vec<TraitRow>>) {
        if self
            .rows
            .as_ref()
            .is_some_and(|known| Arc::ptr_eq(known, rows))
        {
            return;
        }
        self.places.clear();
        for (place, row) in rows.iter().enumerate().filter(|(_, row)| row.instance <= 1) {
            self.places
                .entry((row.id, row.name.clone()))
                .or_insert(place);
        }
        self.rows = Some(Arc::clone(rows));
    }

    pub(super) fn find(&self, id: LabelId, name: &'static str) -> Option<&TraitRow> {
        self.rows
            .as_ref()?
            .get(*self.places.get(&(id, Cow::Borrowed(name)))?)
    }

    /// Returns the traits that a column shows for a label.
    pub(super) fn cell(&self, id: LabelId, column: &Column) -> Vec<&TraitRow> {
        let found = column.traits.iter().filter_map(|name| self.find(id, name));
        found
            .take(if column.joined {
                column.traits.len()
            } else {
                1
            })
            .collect()
    }

    pub(super) fn pieces(&self, id: LabelId) -> usize {
        self.find(id, "instances")
            .map_or(0, |row| row.value as usize)
    }
}

/// Labels of an angle, chosen one after the other.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct AngleChoice(pub(super) [Option<LabelId>; 2]);

impl AngleChoice {
    /// Returns both labels once they are chosen.
    pub(super) fn pair(&self) -> Option<[LabelId; 2]> {
        let [first, second] = self.0;
        Some([first?, second?])
    }
}
