use std::fmt;

use serde::Deserialize;

use super::error::NnError;

/// Numbers in a grid of any number of dimensions, the last dimension fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    shape: Vec<usize>,
    values: TensorValues,
}

/// The numbers of a [`Tensor`].
#[derive(Debug, Clone, PartialEq)]
pub enum TensorValues {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 64-bit integers.
    I64(Vec<i64>),
}

impl Tensor {
    /// A tensor of `shape` holding `values`.
    ///
    /// # Errors
    /// When there are more or fewer values than the shape holds.
    pub fn new(shape: &[usize], values: TensorValues) -> Result<Self, NnError> {
        let count = match &values {
            TensorValues::F32(values) => values.len(),
            TensorValues::I64(values) => values.len(),
        };
        if shape.iter().product::<usize>() == count {
            return Ok(Self {
                shape: shape.to_vec(),
                values,
            });
        }
        Err(NnError::Request(format!(
            "a tensor of shape {shape:?} cannot hold {count} values"
        )))
    }

    /// A tensor of floats.
    ///
    /// # Errors
    /// As [`Tensor::new`].
    pub fn floats(shape: &[usize], values: Vec<f32>) -> Result<Self, NnError> {
        Self::new(shape, TensorValues::F32(values))
    }

    /// A tensor of integers.
    ///
    /// # Errors
    /// As [`Tensor::new`].
    pub fn integers(shape: &[usize], values: Vec<i64>) -> Result<Self, NnError> {
        Self::new(shape, TensorValues::I64(values))
    }

    /// Size of each dimension.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// All numbers.
    #[must_use]
    pub fn values(&self) -> &TensorValues {
        &self.values
    }

    /// The numbers of a float tensor; empty for another kind.
    #[must_use]
    pub fn as_floats(&self) -> &[f32] {
        match &self.values {
            TensorValues::F32(values) => values,
            TensorValues::I64(_) => &[],
        }
    }

    /// The numbers of an integer tensor; empty for another kind.
    #[must_use]
    pub fn as_integers(&self) -> &[i64] {
        match &self.values {
            TensorValues::I64(values) => values,
            TensorValues::F32(_) => &[],
        }
    }
}

/// What a network takes and gives.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Signature {
    /// What is fed, all of it.
    pub inputs: Vec<Port>,
    /// What is read; a network may give more.
    pub outputs: Vec<Port>,
}

/// One input or output of a network.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Port {
    /// Its name in the file.
    pub name: String,
    /// What it is made of.
    pub element: Element,
    /// Size of each dimension; any size where `None` (−1 in files).
    #[serde(deserialize_with = "dimensions")]
    pub shape: Vec<Option<usize>>,
}

/// What a tensor is made of.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(from = "String")]
pub enum Element {
    /// 32-bit floats.
    F32,
    /// 64-bit integers.
    I64,
    /// Something that cannot be fed or read here; its name.
    Other(String),
}

impl From<String> for Element {
    fn from(name: String) -> Self {
        match name.as_str() {
            "f32" => Self::F32,
            "i64" => Self::I64,
            _ => Self::Other(name),
        }
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F32 => "f32",
            Self::I64 => "i64",
            Self::Other(name) => name,
        })
    }
}

impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sizes = self
            .shape
            .iter()
            .map(|size| size.map_or_else(|| "any".to_owned(), |size| size.to_string()));
        write!(
            f,
            "`{}` {} [{}]",
            self.name,
            self.element,
            sizes.collect::<Vec<_>>().join(", ")
        )
    }
}

/// Which way a tensor goes: an input of any size must be left open by the network, an output need not be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Input,
    Output,
}

impl Signature {
    /// Compares this expectation with what a network has.
    ///
    /// # Errors
    /// What was expected and what is there.
    pub fn fits(&self, found: &Signature) -> Result<(), String> {
        ports_fit(&self.inputs, &found.inputs, Way::Input)?;
        let unfed = found
            .inputs
            .iter()
            .find(|port| !self.inputs.iter().any(|fed| fed.name == port.name));
        if let Some(port) = unfed {
            return Err(format!("has an input {port} that was not expected"));
        }
        ports_fit(&self.outputs, &found.outputs, Way::Output)
    }
}

fn ports_fit(expected: &[Port], found: &[Port], way: Way) -> Result<(), String> {
    let kind = if way == Way::Input { "input" } else { "output" };
    for port in expected {
        let Some(there) = found.iter().find(|there| there.name == port.name) else {
            return Err(format!(
                "expected the {kind} {port}, there {}",
                named(found)
            ));
        };
        if there.element != port.element || !shape_fits(&port.shape, &there.shape, way) {
            return Err(format!("expected the {kind} {port}, there is {there}"));
        }
    }
    Ok(())
}

fn named(ports: &[Port]) -> String {
    match ports {
        [] => "is none".to_owned(),
        [port] => format!("is {port}"),
        _ => format!(
            "are {}",
            ports
                .iter()
                .map(Port::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        ),
    }
}

/// A network that does not declare the number of dimensions has an empty shape: only running it can show.
fn shape_fits(expected: &[Option<usize>], found: &[Option<usize>], way: Way) -> bool {
    let size_fits = |(expected, found): (&Option<usize>, &Option<usize>)| match (expected, found) {
        (Some(expected), Some(found)) => expected == found,
        (None, Some(_)) => way == Way::Output,
        (_, None) => true,
    };
    found.is_empty() || (expected.len() == found.len() && expected.iter().zip(found).all(size_fits))
}

fn dimensions<'de, D: serde::Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<Option<usize>>, D::Error> {
    let sizes = Vec::<i64>::deserialize(deserializer)?;
    Ok(sizes
        .into_iter()
        .map(|size| usize::try_from(size).ok())
        .collect())
}
