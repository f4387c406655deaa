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
