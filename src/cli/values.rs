use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec2;

use ostra_cloud::measure::LengthUnit;
use ostra_frames::cameras::IntrinsicsSource;
use ostra_masks::{AnswerSize, MaskFormat};
use ostra_project::EngineName;

/// Returns a parser of engine names; help and errors list all names.
pub(super) fn engine<I: EngineName>() -> impl TypedValueParser<Value = I> {
    PossibleValuesParser::new(I::ALL.iter().map(|id| id.name()))
        .try_map(|name| I::from_name(&name).ok_or("unknown engine"))
}

/// Returns a parser of names of mask formats; help and errors list all names.
pub(super) fn mask_format() -> impl TypedValueParser<Value = MaskFormat> {
    PossibleValuesParser::new(MaskFormat::ALL.map(MaskFormat::name))
        .try_map(|name| name.parse::<MaskFormat>())
}

/// Returns a parser of sizes of answers; help and errors list all names.
pub(super) fn answer_size() -> impl TypedValueParser<Value = AnswerSize> {
    PossibleValuesParser::new(AnswerSize::ALL.map(AnswerSize::name)).try_map(|name| {
        let named = |size: &AnswerSize| size.name() == name;
        AnswerSize::ALL
            .into_iter()
            .find(named)
            .ok_or("no such size")
    })
}

/// Parses `X,Y` in pixels.
pub(super) fn point(text: &str) -> Result<DVec2, String> {
    let [x, y] = numbers(text)?;
    Ok(DVec2::new(x, y))
}

/// Parses `X0,Y0,X1,Y1` in pixels, two opposite corners of a box.
pub(super) fn px_box(text: &str) -> Result<[DVec2; 2], String> {
    let [x0, y0, x1, y1] = numbers(text)?;
    let (a, b) = (DVec2::new(x0, y0), DVec2::new(x1, y1));
    if x0 == x1 || y0 == y1 {
        Err("the box is empty: its corners must differ in x and y".into())
    } else {
        Ok([a.min(b), a.max(b)])
    }
}

/// Parses `FX,FY,CX,CY` in pixels or the path of a file, which is made absolute.
pub(super) fn intrinsics(text: &str) -> Result<IntrinsicsSource, String> {
    match text.parse()? {
        IntrinsicsSource::File(path) => {
            let path = std::path::absolute(&path)
                .map_err(|error| format!("{}: {error}", path.display()))?;
            Ok(IntrinsicsSource::File(path))
        }
        values => Ok(values),
    }
}

/// Parses the symbol of a length unit.
pub(super) fn length_unit(text: &str) -> Result<LengthUnit, String> {
    let mut known = LengthUnit::METRIC.into_iter().chain([LengthUnit::World]);
    let signs = || LengthUnit::METRIC.map(LengthUnit::sign).join(", ");
    known
        .find(|unit| unit.sign() == text)
        .ok_or_else(|| format!("must be {} or {}", signs(), LengthUnit::World.sign()))
}

/// Parses the symbol of a metric unit.
pub(super) fn metric_unit(text: &str) -> Result<LengthUnit, String> {
    length_unit(text)
        .ok()
        .filter(|&unit| unit != LengthUnit::World)
        .ok_or_else(|| {
            let [m, cm, mm] = LengthUnit::METRIC.map(LengthUnit::sign);
            format!("must be {m}, {cm} or {mm}")
        })
}

/// Parses `WxH` in pixels, 16 to 8192 each.
pub(super) fn size(text: &str) -> Result<(u32, u32), String> {
    let parsed = text
        .split_once(['x', 'X'])
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parsed {
        Some((w, h)) if (16..=8192).contains(&w) && (16..=8192).contains(&h) => Ok((w, h)),
        _ => Err("must be WIDTHxHEIGHT in pixels, 16 to 8192 each, such as 480x640".into()),
    }
}

/// Parses `#rrggbb`.
pub(super) fn color(text: &str) -> Result<[u8; 3], String> {
    let hex = text.strip_prefix('#').unwrap_or(text);
    match u32::from_str_radix(hex, 16) {
        Ok(value) if hex.len() == 6 => Ok([(value >> 16) as u8, (value >> 8) as u8, value as u8]),
        _ => Err("must be '#rrggbb', such as '#3cb44b'".into()),
    }
}

/// Parses a finite number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match f64::from_str(text) {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("must be a number above 0".into()),
    }
}

/// Parses a finite number of 0 or more.
pub(super) fn from_zero(text: &str) -> Result<f64, String> {
    match f64::from_str(text) {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(value),
        _ => Err("must be 0 or more".into()),
    }
}

/// Parses the duration of a video in seconds, above 0 and at most an hour.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    positive(text)
        .ok()
        .filter(|&value| value <= 3600.0)
        .ok_or_else(|| "must be above 0 and at most 3600 seconds".into())
}

/// Parses a share from 0 to 1.
pub(super) fn share(text: &str) -> Result<f32, String> {
    match f32::from_str(text) {
        Ok(value) if (0.0..=1.0).contains(&value) => Ok(value),
        _ => Err("must be between 0 and 1".into()),
    }
}

/// Parses a share above 0 and at most 1.
pub(super) fn part(text: &str) -> Result<f64, String> {
    match f64::from_str(text) {
        Ok(value) if value > 0.0 && value <= 1.0 => Ok(value),
        _ => Err("must be above 0 and at most 1".into()),
    }
}

/// Parses a whole number of 1 or more.
pub(super) fn from_one(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(value) if value >= 1 => Ok(value),
        _ => Err("must be a whole number of 1 or more".into()),
    }
}

/// Parses `K,K`, two different frames.
pub(super) fn frame_pair(text: &str) -> Result<[usize; 2], String> {
    let parsed = text
        .split_once(',')
        .and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    parsed
        .filter(|[a, b]| a != b)
        .ok_or_else(|| "must be two different frame numbers, such as 3,17".into())
}

/// Parses `K,X,Y`, a pixel of a frame.
pub(super) fn frame_point(text: &str) -> Result<(usize, DVec2), String> {
    let parsed = text
        .split_once(',')
        .and_then(|(frame, at)| Some((frame.trim().parse().ok()?, point(at).ok()?)));
    parsed.ok_or_else(|| "must be a frame number and a pixel, such as 12,640.5,360".into())
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let fail = || format!("must be {N} numbers separated by commas, without spaces");
    let values: Vec<f64> = text
        .split(',')
        .map(|part| {
            part.trim()
                .parse::<f64>()
                .ok()
                .filter(|value| value.is_finite())
        })
        .collect::<Option<_>>()
        .ok_or_else(fail)?;
    values.try_into().map_err(|_| fail())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_values_are_parsed_and_others_are_rejected() {
        assert_eq!(point("1.5,2").unwrap(), DVec2::new(1.5, 2.0));
        assert_eq!(
            px_box("9,8,1,2").unwrap(),
            [DVec2::new(1.0, 2.0), DVec2::new(9.0, 8.0)]
        );
        assert!(px_box("1,2,1,5").is_err() && point("1").is_err() && point("1,nan").is_err());
        assert_eq!(color("#3cb44b").unwrap(), [60, 180, 75]);
        assert!(color("#fff").is_err() && color("red").is_err());
        assert_eq!(size("480x640").unwrap(), (480, 640));
        assert!(size("480").is_err() && size("0x9").is_err());
        assert_eq!(frame_pair("3,17").unwrap(), [3, 17]);
        assert_eq!(frame_point("12,3.5,4").unwrap(), (12, DVec2::new(3.5, 4.0)));
        assert!(frame_point("3.5,4").is_err() && frame_point("1,2").is_err());
        assert!(
            frame_pair("3").is_err() && frame_pair("3,3").is_err() && frame_pair("3,-1").is_err()
        );
        assert!(seconds("8").is_ok() && seconds("1e300").is_err() && seconds("0").is_err());
        assert!(from_zero("0").is_ok() && from_zero("-1").is_err() && from_zero("inf").is_err());
        assert!(
            intrinsics("0,1,2,3").is_err()
                && share("1.2").is_err()
                && positive("-1").is_err()
                && from_one("0").is_err()
        );
    }
}
