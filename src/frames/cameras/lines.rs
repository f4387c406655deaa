use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::{DMat3, DQuat, DVec3};

use crate::FrameError;
use ostra_core::disk;
use ostra_geometry::{GeometryError, Pose};

/// A text file of numbers, read line by line; errors name the file and the line.
#[derive(Debug, Clone)]
pub struct TextFile {
    pub path: PathBuf,
    pub text: String,
}

/// One line of a [`TextFile`], counted from 1.
#[derive(Debug, Clone, Copy)]
pub struct TextLine<'a> {
    pub number: usize,
    pub text: &'a str,
    path: &'a Path,
}

/// Returns a [`FrameError::Invalid`] for `path`.
pub fn invalid(path: &Path, what: impl Into<String>) -> FrameError {
    FrameError::Invalid {
        path: path.to_owned(),
        what: what.into(),
    }
}

impl TextFile {
    pub fn read(path: &Path) -> Result<Self, FrameError> {
        let text = disk::read_text(path).map_err(|reason| match reason.kind() {
            std::io::ErrorKind::InvalidData => invalid(
                path,
                format!("is not a text file ({reason}); check which file was given"),
            ),
            _ => FrameError::Io {
                path: path.to_owned(),
                reason,
            },
        })?;
        Ok(Self {
            path: path.to_owned(),
            text,
        })
    }

    /// Returns all lines, trimmed.
    pub fn lines(&self) -> impl Iterator<Item = TextLine<'_>> {
        let path = self.path.as_path();
        self.text
            .lines()
            .enumerate()
            .map(move |(i, text)| TextLine {
                number: i + 1,
                text: text.trim(),
                path,
            })
    }

    /// Returns the lines that are neither empty nor a comment (`#`).
    pub fn content(&self) -> impl Iterator<Item = TextLine<'_>> {
        self.lines().filter(|line| !line.is_blank())
    }

    /// Returns all numbers of the file, which must be `N`.
    pub fn numbers<const N: usize>(&self) -> Result<[f64; N], FrameError> {
        let mut all = Vec::with_capacity(N);
        for line in self.content() {
            all.extend(line.numbers()?);
        }
        let count = all.len();
        all.try_into().map_err(|_| {
            invalid(
                &self.path,
                format!("holds {count} numbers where {N} belong; check the file"),
            )
        })
    }
}

impl<'a> TextLine<'a> {
    pub fn is_blank(&self) -> bool {
        self.text.is_empty() || self.text.starts_with('#')
    }

    pub fn words(&self) -> std::str::SplitWhitespace<'a> {
        self.text.split_whitespace()
    }

    pub fn error(&self, what: &str) -> FrameError {
        invalid(self.path, self.fault(what))
    }

    /// Returns a message about this line, without the file's name.
    pub fn fault(&self, what: &str) -> String {
        format!("line {}: {what}", self.number)
    }

    /// Reads one word of the line.
    pub fn parse<T: FromStr>(&self, word: Option<&str>) -> Result<T, FrameError> {
        let word =
            word.ok_or_else(|| self.error("ends too early; check that the file is whole"))?;
        word.parse()
            .or_else(|_| usual_spelling(word).parse())
            .map_err(|_| self.error(&format!("'{word}' is not the number expected here")))
    }

    /// Returns all words of the line as numbers.
    pub fn numbers(&self) -> Result<Vec<f64>, FrameError> {
        self.words().map(|word| self.parse(Some(word))).collect()
    }

    /// Returns all words of the line as `N` numbers.
    pub fn array<const N: usize>(&self) -> Result<[f64; N], FrameError> {
        let numbers = self.numbers()?;
        let count = numbers.len();
        numbers
            .try_into()
            .map_err(|_| self.error(&format!("has {count} numbers where {N} belong")))
    }
}

/// Returns the usual spelling of a non-finite number; any other word unchanged.
///
/// Programs built with Microsoft's compiler spell these numbers differently.
pub fn usual_spelling(word: &str) -> &str {
    let lower = word.to_ascii_lowercase();
    let (sign, rest) = lower
        .strip_prefix('-')
        .map_or(("", lower.as_str()), |rest| ("-", rest));
    let starts = |names: &[&str]| names.iter().any(|name| rest.starts_with(name));
    match sign {
        _ if rest.starts_with("nan(") || starts(&["1.#qnan", "1.#snan", "1.#ind"]) => "NaN",
        "-" if starts(&["1.#inf"]) => "-inf",
        _ if starts(&["1.#inf"]) => "inf",
        _ => word,
    }
}

/// Returns the pose of a quaternion (x, y, z, w), which is normalised, and a translation.
pub fn pose_from_quaternion(xyzw: [f64; 4], translation: DVec3) -> Result<Pose, GeometryError> {
    let rotation = DQuat::from_array(xyzw);
    if !rotation.is_finite() || !translation.is_finite() {
        return Err(GeometryError::NotFinite {
            what: "pose".into(),
        });
    }
    let length = rotation.length();
    if length < 1e-6 {
        return Err(GeometryError::NotARotation { error: 1.0 });
    }
    // A quaternion of unit length stays unchanged, bit for bit.
    let rotation = if (length - 1.0).abs() > 1e-12 {
        rotation / length
    } else {
        rotation
    };
    Ok(Pose {
        rotation,
        translation,
    })
}

/// Returns the pose in the upper three rows of a 4×4 matrix, row by row.
pub fn pose_from_rows(rows: &[f64]) -> Result<Pose, GeometryError> {
    let column = |c: usize| DVec3::new(rows[c], rows[4 + c], rows[8 + c]);
    Pose::from_matrix(DMat3::from_cols(column(0), column(1), column(2)), column(3))
}
