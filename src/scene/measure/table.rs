use std::fmt::Write as _;

use crate::masks::{LabelId, LabelTree};

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

/// One measured (or true) trait of one instance of a label.
#[derive(Debug, Clone, PartialEq)]
pub struct TraitRow {
    /// Name of the label.
    pub label: String,
    /// Names from the top level down to the label, joined by ` › `.
    pub path: String,
    /// 1 for the first instance of the label; 0 = the label as a whole.
    pub instance: usize,
    /// Which trait, e.g. `length`; the same name means the same thing in truth and measurement.
    pub name: &'static str,
    /// In the unit that `dimension` says.
    pub value: f64,
    /// Power of the world unit.
    pub dimension: Dimension,
    /// How the value is defined, one sentence.
    pub definition: &'static str,
}

impl TraitRow {
    /// Names of all labels above `id` and its own, joined by ` › `.
    #[must_use]
    pub fn path_of(tree: &LabelTree, id: LabelId) -> String {
        let names: Vec<&str> =
            tree.path(id).into_iter().filter_map(|id| tree.get(id)).map(|label| label.name.as_str()).collect();
        names.join(" › ")
    }
}

/// The rows as CSV with the columns `label,path,instance,trait,value,unit,definition`; `unit` names the world unit,
/// e.g. `m` (areas get `m^2`, volumes `m^3`, angles `deg`).
#[must_use]
pub fn traits_csv(rows: &[TraitRow], unit: &str) -> String {
    let mut csv = String::from("label,path,instance,trait,value,unit,definition\n");
    for row in rows {
        let unit = match row.dimension {
            Dimension::Count => String::new(),
            Dimension::Length => unit.to_owned(),
            Dimension::Area => format!("{unit}^2"),
            Dimension::Volume => format!("{unit}^3"),
            Dimension::Angle => "deg".to_owned(),
        };
        let (label, path, definition) = (quoted(&row.label), quoted(&row.path), quoted(row.definition));
        let _ = writeln!(
            csv,
            "{label},{path},{},{},{},{},{definition}",
            row.instance,
            row.name,
            significant(row.value),
            quoted(&unit)
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
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_and_units() {
        let row = TraitRow {
            label: "a,b".into(),
            path: "top › a,b".into(),
            instance: 2,
            name: "area",
            value: 0.001_234_567_8,
            dimension: Dimension::Area,
            definition: "say \"x\"",
        };
        let csv = traits_csv(&[row], "m");
        assert_eq!(csv.lines().nth(1).unwrap(), r#""a,b","top › a,b",2,area,0.00123457,m^2,"say ""x""""#);
    }

    #[test]
    fn significant_digits() {
        assert_eq!(significant(123_456.7), "123457");
        assert_eq!(significant(0.5), "0.5");
        assert_eq!(significant(-0.000_012_345_678), "-0.0000123457");
        assert_eq!(significant(0.0), "0");
    }
}
