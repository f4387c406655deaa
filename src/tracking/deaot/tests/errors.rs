//! Tests with missing or unsuitable networks.

use super::super::Deaot;
use super::{runtime, tiny};
use ostra_compute::nn::{Network, NnError};

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn networks_in_the_wrong_order_are_rejected() {
    let runtime = runtime();
    let load = |part: &str| {
        Network::load(
            &runtime,
            &tiny().join(format!("deaot-tiny-{part}.onnx")),
            None,
        )
        .unwrap()
    };
    let networks = ["encoder", "propagate", "remember", "identify"].map(load);
    let error = Deaot::new(networks).unwrap_err();
    assert!(matches!(error, NnError::Mismatch { .. }), "{error}");
    assert!(error.to_string().contains("expected the input"), "{error}");
}

#[test]
fn missing_networks_are_named_in_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let error = Deaot::load(folder.path()).unwrap_err();
    assert!(error.to_string().contains("deaot"), "{error}");
}
