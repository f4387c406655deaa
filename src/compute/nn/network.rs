use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use ort::session::{RunOptions, Session, SessionInputValue};
use ort::value::{DynValue, Outlet, TensorElementType, TensorRef};

use super::error::NnError;
use super::runtime::{Provider, Runtime, note_fall_back};
use super::tensor::{Element, Port, Signature, Tensor, TensorValues};

/// A loaded network.
///
/// Threads may share it. Runs are executed one after the other, each on all cores.
#[derive(Debug)]
pub struct Network {
    path: PathBuf,
    signature: Signature,
    session: Mutex<Session>,
}

impl Network {
    /// Loads a network and compares its interface with `expected`, if given.
    ///
    /// The network runs on the currently chosen [`Provider`]. If that does not start, it runs on
    /// the processor, and the fallback is recorded.
    ///
    /// # Errors
    /// [`NnError::Io`], [`NnError::NotANetwork`] or [`NnError::Mismatch`].
    pub fn load(
        runtime: &Runtime,
        path: &Path,
        expected: Option<&Signature>,
    ) -> Result<Self, NnError> {
        std::fs::File::open(path).map_err(|reason| NnError::Io {
            path: path.to_owned(),
            reason,
        })?;
        let broken = |error: ort::Error| NnError::NotANetwork {
            path: path.to_owned(),
            what: one_line(&error),
        };
        let provider = Provider::chosen();
        let session = session(runtime, path, provider).or_else(|error| {
            if provider == Provider::Cpu {
                return Err(error);
            }
            let session = session(runtime, path, Provider::Cpu)?;
            let (path, provider) = (path.display(), provider.name());
            note_fall_back(format!(
                "{path}: runs on the processor, as '{provider}' does not start ({})",
                one_line(&error)
            ));
            Ok(session)
        });
        let session = session.map_err(broken)?;
        let there = Signature {
            inputs: ports(session.inputs()),
            outputs: ports(session.outputs()),
        };
        let mut network = Self {
            path: path.to_owned(),
            signature: there,
            session: Mutex::new(session),
        };
        if let Some(expected) = expected {
            network.expect(expected)?;
            network.read_only(&expected.outputs);
        }
        Ok(network)
    }

    /// Compares the interface with `expected`.
    ///
    /// # Errors
    /// [`NnError::Mismatch`] if it differs.
    pub(super) fn expect(&self, expected: &Signature) -> Result<(), NnError> {
        expected
            .fits(&self.signature)
            .map_err(|what| NnError::Mismatch {
                path: self.path.clone(),
                what,
            })
    }

    /// Restricts the outputs that are read, in this order; without any, all are read.
    pub(super) fn read_only(&mut self, outputs: &[Port]) {
        if !outputs.is_empty() {
            self.signature.outputs = outputs.to_vec();
        }
    }

    /// Returns the path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the inputs, and the outputs that are read.
    #[must_use]
    pub fn signature(&self) -> &Signature {
        &self.signature
    }

    /// Runs the network on named inputs; returns the outputs in signature order.
    ///
    /// See [`Network::signature`].
    ///
    /// # Errors
    /// [`NnError::Run`] if an input is missing or does not fit, an output has another type, or
    /// memory is insufficient.
    pub fn run(&self, inputs: &[(&str, &Tensor)]) -> Result<Vec<Tensor>, NnError> {
        RunOptions::new()
            .and_then(|options| self.run_with(inputs, &options))
            .map_err(|error| self.failed(&error))
    }

    /// As [`Network::run`], but returns `None` soon after `is_wanted` becomes false.
    ///
    /// # Errors
    /// As [`Network::run`].
    pub fn run_while(
        &self,
        inputs: &[(&str, &Tensor)],
        is_wanted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Vec<Tensor>>, NnError> {
        let options = RunOptions::new().map_err(|error| self.failed(&error))?;
        let given = std::thread::scope(|scope| {
            let (running, ended) = channel::<()>();
            let options = &options;
            scope.spawn(move || terminate_unless(options, is_wanted, &ended));
            let given = self.run_with(inputs, options);
            drop(running);
            given
        });
        match given {
            Err(_) if !is_wanted() => Ok(None),
            given => given.map(Some).map_err(|error| self.failed(&error)),
        }
    }

    fn run_with(
        &self,
        inputs: &[(&str, &Tensor)],
        options: &RunOptions,
    ) -> ort::Result<Vec<Tensor>> {
        let fed = inputs
            .iter()
            .map(|&(name, tensor)| Ok((Cow::Borrowed(name), view(tensor)?)));
        let fed = fed.collect::<ort::Result<Vec<(Cow<'_, str>, SessionInputValue<'_>)>>>()?;
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let given = session.run_with_options(fed, options)?;
        let read = |port: &Port| {
            let missing = || ort::Error::new(format!("no output `{}`", port.name));
            given.get(&port.name).ok_or_else(missing).and_then(copied)
        };
        self.signature.outputs.iter().map(read).collect()
    }

    fn failed(&self, error: &ort::Error) -> NnError {
        NnError::Run {
            path: self.path.clone(),
            what: one_line(error),
        }
    }
}

/// Interval at which `is_wanted` is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Terminates a run that is no longer wanted; returns when the run has `ended`.
fn terminate_unless(
    options: &RunOptions,
    is_wanted: &(dyn Fn() -> bool + Sync),
    ended: &Receiver<()>,
) {
    while ended.recv_timeout(POLL_INTERVAL) == Err(RecvTimeoutError::Timeout) {
        if !is_wanted() {
            // If this fails, the run continues to its end.
            let _ = options.terminate();
            return;
        }
    }
}

/// Creates a session.
///
/// Spinning is off: waiting threads would take cores from the threads that prepare the input.
fn session(runtime: &Runtime, path: &Path, provider: Provider) -> ort::Result<Session> {
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    Session::builder(runtime.environment())?
        .with_intra_threads(threads)?
        .with_intra_op_spinning(false)?
        .with_deterministic_compute(true)?
        .with_execution_providers(provider.registered())?
        .commit_from_file(path)
}

fn ports(outlets: &[Outlet]) -> Vec<Port> {
    outlets.iter().map(port).collect()
}

fn port(outlet: &Outlet) -> Port {
    let kind = outlet.dtype();
    let element = match kind.tensor_type() {
        Some(TensorElementType::Float32) => Element::F32,
        Some(TensorElementType::Int64) => Element::I64,
        Some(other) => Element::Other(other.to_string()),
        None => Element::Other("no tensor".to_owned()),
    };
    let sizes = kind.tensor_shape().map(|shape| {
        shape
            .iter()
            .map(|&size| usize::try_from(size).ok())
            .collect()
    });
    Port {
        name: outlet.name().to_owned(),
        element,
        shape: sizes.unwrap_or_default(),
    }
}

fn view(tensor: &Tensor) -> ort::Result<SessionInputValue<'_>> {
    Ok(match tensor.values() {
        TensorValues::F32(values) => {
            TensorRef::from_array_view((tensor.shape(), values.as_slice()))?.into()
        }
        TensorValues::I64(values) => {
            TensorRef::from_array_view((tensor.shape(), values.as_slice()))?.into()
        }
    })
}

fn copied(value: &DynValue) -> ort::Result<Tensor> {
    let (shape, values) = if value.dtype().tensor_type() == Some(TensorElementType::Int64) {
        let (shape, values) = value.try_extract_tensor::<i64>()?;
        (shape, TensorValues::I64(values.to_vec()))
    } else {
        let (shape, values) = value.try_extract_tensor::<f32>()?;
        (shape, TensorValues::F32(values.to_vec()))
    };
    let shape: Vec<usize> = shape
        .iter()
        .map(|&size| usize::try_from(size).unwrap_or(0))
        .collect();
    Tensor::new(&shape, values).map_err(|error| ort::Error::new(error.to_string()))
}

/// Joins the lines of ONNX Runtime's multi-line messages.
fn one_line(error: &ort::Error) -> String {
    error
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}
