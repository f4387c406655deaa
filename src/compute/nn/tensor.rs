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
