//! Traits with their units as rows of a table.

use std::borrow::Cow;
use std::fmt::Write as _;

use ostra_masks::{LabelId, LabelTree};

/// One measured (or true) trait of one instance of a label.
#[derive(Debug, Clone, PartialEq)]
pub struct TraitRow {
    /// Which label.
    pub id: LabelId,
    /// Name of the label.
    pub label: String,
    /// Names from the top level down to the label, joined by ` › `.
    pub path: String,
    /// 1 for the first instance of the label; 0 = the label as a whole.
    pub instance: usize,
    /// Which trait, e.g. `length`; the same name means the same thing in truth and measurement.
    pub name: Cow<'static, str>,
    /// In the unit that `dimension` says.
    pub value: f64,
    /// Power of the world unit.
    pub dimension: Dimension,
    /// How the value is defined, one sentence.
    pub definition: Cow<'static, str>,
    /// How many points the value was computed from; 0 for an exact value.
    pub points: usize,
}

/// A trait before it is known whose it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trait {
    name: Cow<'static, str>,
    value: (f64, Dimension),
    definition: Cow<'static, str>,
    points: usize,
}

impl Trait {
    pub(super) fn new(
        name: impl Into<Cow<'static, str>>,
        value: (f64, Dimension),
        definition: impl Into<Cow<'static, str>>,
        points: usize,
    ) -> Self {
        Self {
            name: name.into(),
            value,
            definition: definition.into(),
            points,
        }
    }

    /// Tells that so many points were left out as stray; nothing where it is none.
    pub(super) fn leaving_out(self, stray: usize) -> Self {
        match stray {
            0 => self,
            1 => Self {
                definition: format!("{}; 1 stray point left out", self.definition).into(),
                ..self
            },
            _ => Self {
                definition: format!("{}; {stray} stray points left out", self.definition).into(),
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
            value: (value, dimension),
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
    /// Names of all labels above `id` and its own, joined by ` › `.
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

/// The rows as CSV with the columns `label,path,instance,trait,value,unit,definition,points`, lengths in `unit` (areas
/// in its square, e.g. `m^2`, volumes in its cube, angles in `deg`).
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

/// Six significant digits, without an exponent.
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

/// A cell of text. A leading apostrophe keeps spreadsheets from taking it for a formula (OWASP, "CSV Injection").
fn quoted(text: &str) -> String {
    let is_formula = text
        .trim_start_matches(' ')
        .starts_with(['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠']);
    let mark = if is_formula { "'" } else { "" };
    // Control characters would steer a terminal that shows the file.
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

/// What kind of number a trait is: which power of the world unit it carries.
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
    /// Which power of the world unit it carries.
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

/// What lengths are told in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LengthUnit {
    /// Metres, the unit of a world whose scale is known.
    #[default]
    Metre,
    /// Centimetres of such a world.
    Centimetre,
    /// Millimetres of such a world.
    Millimetre,
    /// The unit of a world whose scale nobody told.
    World,
}

impl LengthUnit {
    /// Units of a world whose scale is known.
    pub const METRIC: [Self; 3] = [Self::Metre, Self::Centimetre, Self::Millimetre];

    /// Its sign.
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

    /// A length in this unit, in metres.
    #[must_use]
    pub fn metres(self, length: f64) -> f64 {
        length / self.per_world_unit()
    }

    /// A value in world units, their squares or cubes, in this unit; counts and angles stay.
    #[must_use]
    pub fn value(self, value: f64, dimension: Dimension) -> f64 {
        value * self.per_world_unit().powi(dimension.power())
    }

    /// The unit of values of a dimension: `mm^2`, `deg`, nothing for a count.
    #[must_use]
    pub fn name(self, dimension: Dimension) -> String {
        match dimension {
            Dimension::Count => String::new(),
            Dimension::Angle => "deg".to_owned(),
            Dimension::Length => self.sign().to_owned(),
            Dimension::Area | Dimension::Volume => format!("{}^{}", self.sign(), dimension.power()),
        }
    }

    /// A value in world units as a person reads it: `12.3 mm`, `35°`; four significant digits.
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
    fn csv_quotes_and_units() {
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
    fn text_that_spreadsheets_would_run_is_marked() {
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
    fn significant_digits() {
        assert_eq!(significant(123_456.7), "123457");
        assert_eq!(significant(0.5), "0.5");
        assert_eq!(significant(-0.000_012_345_678), "-0.0000123457");
        assert_eq!(significant(0.0), "0");
    }

    #[test]
    fn volumes_take_the_cube_of_the_factor() {
        assert_eq!(LengthUnit::Millimetre.value(2e-9, Dimension::Volume), 2.0);
        assert_eq!(
            LengthUnit::Centimetre.text(0.012_341, Dimension::Length),
            "1.234 cm"
        );
        assert_eq!(LengthUnit::Millimetre.text(35.0, Dimension::Angle), "35.0°");
        assert_eq!(LengthUnit::World.name(Dimension::Area), "units^2");
    }
}
