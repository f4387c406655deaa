//! Traits with their units, as rows of a table.

use std::borrow::Cow;
use std::fmt::Write as _;

use ostra_masks::{LabelId, LabelTree};

/// One measured (or true) trait of one instance of a label.
#[derive(Debug, Clone, PartialEq)]
pub struct TraitRow {
    /// Id of the label.
    pub id: LabelId,
    /// Name of the label.
    pub label: String,
    /// Names from the top level down to the label, joined by ` › `.
    pub path: String,
    /// Instance number, from 1; 0 is the label as a whole.
    pub instance: usize,
    /// Name of the trait, e.g. `length`. It means the same in ground truth and measurement.
    pub name: Cow<'static, str>,
    /// Value in world units to the power given by `dimension`.
    pub value: f64,
    /// Kind of quantity, which gives the power of the world unit.
    pub dimension: Dimension,
    /// Definition of the value in one sentence.
    pub definition: Cow<'static, str>,
    /// Number of points that the value was computed from; 0 for an exact value.
    pub points: usize,
}

/// A trait that is not yet assigned to a label.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trait {
    name: Cow<'static, str>,
    value: f64,
    dimension: Dimension,
    definition: Cow<'static, str>,
    points: usize,
}

impl Trait {
    pub(super) fn new(
        name: impl Into<Cow<'static, str>>,
        value: f64,
        dimension: Dimension,
        definition: impl Into<Cow<'static, str>>,
        points: usize,
    ) -> Self {
        Self {
            name: name.into(),
            value,
            dimension,
            definition: definition.into(),
            points,
        }
    }

    /// Adds the number of excluded points to the definition, if there are any.
    pub(super) fn leaving_out(self, outliers: usize) -> Self {
        match outliers {
            0 => self,
            1 => Self {
                definition: format!("{}; 1 outlying point left out", self.definition).into(),
                ..self
            },
            _ => Self {
                definition: format!("{}; {outliers} outlying points left out", self.definition)
                    .into(),
                ..self
            },
        }
    }

    pub(super) fn row(self, tree: &LabelTree, id: LabelId, instance: usize) -> TraitRow {
        let label = tree
            .get(id)
            .map_or_else(String::new, |label| label.name.clone());
        let Self {
            name,
            value,
            dimension,
            definition,
            points,
        } = self;
        TraitRow {
            id,
            label,
            path: TraitRow::path_of(tree, id),
            instance,
            name,
            value,
            dimension,
            definition,
            points,
        }
    }
}

impl TraitRow {
    /// Returns the names of all ancestors of `id` and its own, joined by ` › `.
    #[must_use]
    pub fn path_of(tree: &LabelTree, id: LabelId) -> String {
        let names: Vec<&str> = tree
            .path(id)
            .into_iter()
            .filter_map(|id| tree.get(id))
            .map(|label| label.name.as_str())
            .collect();
        names.join(" › ")
    }
}

/// Returns the rows as CSV, with lengths in `unit`.
///
/// The columns are `label,path,instance,trait,value,unit,definition,points`. Areas are in the
/// square of the unit, e.g. `m^2`, volumes in its cube and angles in `deg`.
#[must_use]
pub fn traits_csv(rows: &[TraitRow], unit: LengthUnit) -> String {
    let mut csv = String::from("label,path,instance,trait,value,unit,definition,points\n");
    for row in rows {
        let [label, path, name, definition] =
            [&*row.label, &row.path, &row.name, &row.definition].map(quoted);
        let _ = writeln!(
            csv,
            "{label},{path},{},{name},{},{},{definition},{}",
            row.instance,
            significant(unit.value(row.value, row.dimension)),
            quoted(&unit.name(row.dimension)),
            row.points
        );
    }
    csv
}

/// Formats a value with six significant digits, without an exponent.
fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (5 - value.abs().log10().floor() as i32).clamp(0, 17) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// Formats a text cell.
///
/// A leading apostrophe keeps spreadsheets from reading it as a formula (OWASP, "CSV Injection").
fn quoted(text: &str) -> String {
    let is_formula = text
        .trim_start_matches(' ')
        .starts_with(['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠']);
    let mark = if is_formula { "'" } else { "" };
    // Control characters would affect a terminal that shows the file.
    let text: String = mark
        .chars()
        .chain(text.chars().map(|c| if c.is_control() { ' ' } else { c }))
        .collect();
    if text.contains([',', '"']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text
    }
}

/// Kind of quantity of a trait, which gives the power of the world unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// A plain number.
    Count,
    /// In world units.
    Length,
    /// In square world units.
    Area,
    /// In cubic world units.
    Volume,
    /// In degrees.
    Angle,
}

impl Dimension {
    /// Returns the power of the world unit.
    #[must_use]
    pub const fn power(self) -> i32 {
        match self {
            Self::Count | Self::Angle => 0,
            Self::Length => 1,
            Self::Area => 2,
            Self::Volume => 3,
        }
    }
}

/// Unit in which lengths are shown.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum LengthUnit {
    /// Metres, the unit of a world of known scale.
    #[default]
    Metre,
    /// Centimetres, in a world of known scale.
    Centimetre,
    /// Millimetres, in a world of known scale.
    Millimetre,
    /// World units, in a world of unknown scale.
    World,
}

impl LengthUnit {
    /// Units for a world of known scale.
    pub const METRIC: [Self; 3] = [Self::Metre, Self::Centimetre, Self::Millimetre];

    /// Returns the symbol of the unit.
    #[must_use]
    pub const fn sign(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::World => "units",
        }
    }

    const fn per_world_unit(self) -> f64 {
        match self {
            Self::Metre | Self::World => 1.0,
            Self::Centimetre => 100.0,
            Self::Millimetre => 1000.0,
        }
    }

    /// Converts a length in this unit to metres.
    #[must_use]
    pub fn metres(self, length: f64) -> f64 {
        length / self.per_world_unit()
    }

    /// Converts a value in world units, or their squares or cubes, to this unit.
    ///
    /// Counts and angles are unchanged.
    #[must_use]
    pub fn value(self, value: f64, dimension: Dimension) -> f64 {
        value * self.per_world_unit().powi(dimension.power())
    }

    /// Returns the unit name for a dimension: `mm^2`, `deg`, or an empty string for a count.
    #[must_use]
    pub fn name(self, dimension: Dimension) -> String {
        match dimension {
            Dimension::Count => String::new(),
            Dimension::Angle => "deg".to_owned(),
            Dimension::Length => self.sign().to_owned(),
            Dimension::Area | Dimension::Volume => format!("{}^{}", self.sign(), dimension.power()),
        }
    }

    /// Formats a value in world units for display: `12.3 mm`, `35°`.
    ///
    /// Lengths, areas and volumes have four significant digits.
    #[must_use]
    pub fn text(self, value: f64, dimension: Dimension) -> String {
        let value = self.value(value, dimension);
        match dimension {
            Dimension::Count => format!("{value:.0}"),
            Dimension::Angle => format!("{value:.1}°"),
            Dimension::Length => format!("{} {}", brief(value), self.sign()),
            Dimension::Area => format!("{} {}²", brief(value), self.sign()),
            Dimension::Volume => format!("{} {}³", brief(value), self.sign()),
        }
    }
}

fn brief(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (3 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_cells_and_converts_units() {
        let row = TraitRow {
            id: LabelId(1),
            label: "a,b".into(),
            path: "top › a,b".into(),
            instance: 2,
            name: "area".into(),
            value: 0.001_234_567_8,
            dimension: Dimension::Area,
            definition: "say \"x\"".into(),
            points: 9,
        };
        let line = |unit| {
            traits_csv(std::slice::from_ref(&row), unit)
                .lines()
                .nth(1)
                .unwrap()
                .to_owned()
        };
        assert_eq!(
            line(LengthUnit::Metre),
            r#""a,b","top › a,b",2,area,0.00123457,m^2,"say ""x""",9"#
        );
        assert!(line(LengthUnit::Millimetre).contains(",1234.57,mm^2,"));
    }

    #[test]
    fn spreadsheet_formulas_are_escaped() {
        for formula in [
            "=HYPERLINK(1)",
            "+1",
            "-2+3",
            "@SUM(A1)",
            "\t=1",
            " =1",
            "＝1",
        ] {
            assert!(
                quoted(formula).trim_start_matches('"').starts_with('\''),
                "{formula}"
            );
        }
        assert_eq!(quoted("leaf - 2"), "leaf - 2");
    }

    #[test]
    fn values_have_six_significant_digits() {
        assert_eq!(significant(123_456.7), "123457");
        assert_eq!(significant(0.5), "0.5");
        assert_eq!(significant(-0.000_012_345_678), "-0.0000123457");
        assert_eq!(significant(0.0), "0");
    }

    #[test]
    fn volumes_scale_with_the_cube_of_the_unit() {
        assert_eq!(LengthUnit::Millimetre.value(2e-9, Dimension::Volume), 2.0);
        assert_eq!(
            LengthUnit::Centimetre.text(0.012_341, Dimension::Length),
            "1.234 cm"
        );
        assert_eq!(LengthUnit::Millimetre.text(35.0, Dimension::Angle), "35.0°");
        assert_eq!(LengthUnit::World.name(Dimension::Area), "units^2");
    }
}
