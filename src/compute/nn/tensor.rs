use std::fmt;

use serde::Deserialize;

use super::error::NnError;

/// An array of any number of dimensions, in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    shape: Vec<usize>,
    values: TensorValues,
}

/// Values of a [`Tensor`].
#[derive(Debug, Clone, PartialEq)]
pub enum TensorValues {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 64-bit integers.
    I64(Vec<i64>),
}

impl Tensor {
    /// Creates a tensor of `shape` from `values`.
    ///
    /// # Errors
    /// Fails if the number of values does not match the shape.
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

    /// Creates a tensor of floats.
    ///
    /// # Errors
    /// As [`Tensor::new`].
    pub fn floats(shape: &[usize], values: Vec<f32>) -> Result<Self, NnError> {
        Self::new(shape, TensorValues::F32(values))
    }

    /// Creates a tensor of integers.
    ///
    /// # Errors
    /// As [`Tensor::new`].
    pub fn integers(shape: &[usize], values: Vec<i64>) -> Result<Self, NnError> {
        Self::new(shape, TensorValues::I64(values))
    }

    /// Returns the size of each dimension.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Returns all values.
    #[must_use]
    pub fn values(&self) -> &TensorValues {
        &self.values
    }

    /// Returns the values of a float tensor; empty for other types.
    #[must_use]
    pub fn as_floats(&self) -> &[f32] {
        match &self.values {
            TensorValues::F32(values) => values,
            TensorValues::I64(_) => &[],
        }
    }

    /// Returns the values of an integer tensor; empty for other types.
    #[must_use]
    pub fn as_integers(&self) -> &[i64] {
        match &self.values {
            TensorValues::I64(values) => values,
            TensorValues::F32(_) => &[],
        }
    }
}

/// Inputs and outputs of a network.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Signature {
    /// All inputs.
    pub inputs: Vec<Port>,
    /// Outputs that are read; a network may have more.
    pub outputs: Vec<Port>,
}

/// One input or output of a network.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Port {
    /// Name in the file.
    pub name: String,
    /// Element type.
    pub element: Element,
    /// Size of each dimension; `None` is any size (−1 in files).
    #[serde(deserialize_with = "dimensions")]
    pub shape: Vec<Option<usize>>,
}

/// Element type of a tensor.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(from = "String")]
pub enum Element {
    /// 32-bit floats.
    F32,
    /// 64-bit integers.
    I64,
    /// A type that is not supported here, with its name.
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

/// Direction of a port.
///
/// An input of any size must be left open by the network; an output need not be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PortRole {
    Input,
    Output,
}

impl Signature {
    /// Compares this expectation with a network's signature.
    ///
    /// # Errors
    /// Returns the expected and the actual interface.
    pub fn fits(&self, found: &Signature) -> Result<(), String> {
        ports_fit(&self.inputs, &found.inputs, PortRole::Input)?;
        let unfed = found
            .inputs
            .iter()
            .find(|port| !self.inputs.iter().any(|fed| fed.name == port.name));
        if let Some(port) = unfed {
            return Err(format!("has an input {port} that was not expected"));
        }
        ports_fit(&self.outputs, &found.outputs, PortRole::Output)
    }
}

fn ports_fit(expected: &[Port], found: &[Port], way: PortRole) -> Result<(), String> {
    let kind = if way == PortRole::Input {
        "input"
    } else {
        "output"
    };
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

/// Compares shapes; an undeclared shape is empty and fits until the network runs.
fn shape_fits(expected: &[Option<usize>], found: &[Option<usize>], way: PortRole) -> bool {
    let size_fits = |(expected, found): (&Option<usize>, &Option<usize>)| match (expected, found) {
        (Some(expected), Some(found)) => expected == found,
        (None, Some(_)) => way == PortRole::Output,
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
