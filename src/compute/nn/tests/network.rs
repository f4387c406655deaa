use super::super::{Catalogue, Network, NnError, Signature, Tensor};
use super::ready;

fn expected(name: &str) -> Signature {
    Catalogue::bundled().unwrap().entry(name).unwrap().files()[0]
        .signature
        .clone()
        .unwrap()
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn outputs_are_returned_in_the_requested_order() {
    let (runtime, folder) = ready();
    let mut wanted = expected("xfeat");
    wanted.outputs.reverse();
    let network = Network::load(&runtime, &folder.join("xfeat.onnx"), Some(&wanted)).unwrap();
    let input = Tensor::floats(
        &[1, 1, 64, 96],
        (0..64 * 96).map(|at| (at % 7) as f32 / 7.0).collect(),
    )
    .unwrap();
    let given = network.run(&[("input", &input)]).unwrap();
    let shapes: Vec<&[usize]> = given.iter().map(Tensor::shape).collect();
    assert_eq!(shapes, [[1, 1, 8, 12], [1, 65, 8, 12], [1, 64, 8, 12]]);
    assert!(given[0].as_floats().iter().all(|value| value.is_finite()));
    assert_eq!(
        given,
        network.run(&[("input", &input)]).unwrap(),
        "the same again"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn threads_can_share_a_network() {
    let (runtime, folder) = ready();
    let network = Network::load(
        &runtime,
        &folder.join("xfeat.onnx"),
        Some(&expected("xfeat")),
    )
    .unwrap();
    let input = Tensor::floats(
        &[1, 1, 64, 64],
        (0..64 * 64).map(|at| (at % 5) as f32 / 5.0).collect(),
    )
    .unwrap();
    let alone = network.run(&[("input", &input)]).unwrap();
    std::thread::scope(|scope| {
        let running = [0; 4].map(|_| scope.spawn(|| network.run(&[("input", &input)]).unwrap()));
        running
            .into_iter()
            .for_each(|run| assert_eq!(run.join().unwrap(), alone));
    });
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn run_ends_when_it_is_no_longer_wanted() {
    let (runtime, folder) = ready();
    let network = Network::load(
        &runtime,
        &folder.join("xfeat.onnx"),
        Some(&expected("xfeat")),
    )
    .unwrap();
    // Large enough to be still running when it is polled for the first time.
    let large = Tensor::floats(&[1, 1, 2048, 4096], vec![0.5; 2048 * 4096]).unwrap();
    assert!(
        network
            .run_while(&[("input", &large)], &|| false)
            .unwrap()
            .is_none()
    );
    let small = Tensor::floats(&[1, 1, 64, 64], vec![0.5; 64 * 64]).unwrap();
    let given = network.run_while(&[("input", &small)], &|| true).unwrap();
    assert_eq!(
        given,
        Some(network.run(&[("input", &small)]).unwrap()),
        "the network is as good as before"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn mismatch_error_shows_both_interfaces() {
    let (runtime, folder) = ready();
    let error = Network::load(
        &runtime,
        &folder.join("yolox_nano.onnx"),
        Some(&expected("xfeat")),
    )
    .unwrap_err();
    let text = error.to_string();
    let reported =
        "expected the input `input` f32 [1, 1, any, any], there is `images` f32 [1, 3, 416, 416]";
    assert!(
        matches!(error, NnError::Mismatch { .. })
            && text.contains("yolox_nano.onnx")
            && text.contains(reported),
        "{text}"
    );
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn file_that_is_not_a_network_is_rejected() {
    let (runtime, folder) = ready();
    let scratch = tempfile::tempdir().unwrap();
    let broken = scratch.path().join("broken.onnx");
    let whole = std::fs::read(folder.join("xfeat.onnx")).unwrap();
    for content in [&b"no network at all"[..], &[], &whole[..whole.len() / 2]] {
        std::fs::write(&broken, content).unwrap();
        let error = Network::load(&runtime, &broken, Some(&expected("xfeat"))).unwrap_err();
        assert!(error.to_string().contains("broken.onnx"), "{error}");
    }
    let error = Network::load(&runtime, &scratch.path().join("nowhere.onnx"), None).unwrap_err();
    assert!(matches!(error, NnError::Io { .. }), "{error}");
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn unsuitable_inputs_return_an_error() {
    let (runtime, folder) = ready();
    let network = Network::load(&runtime, &folder.join("yolox_nano.onnx"), None).unwrap();
    let small = Tensor::floats(&[1, 3, 8, 8], vec![0.0; 192]).unwrap();
    let empty = Tensor::floats(&[1, 3, 0, 8], Vec::new()).unwrap();
    let whole = Tensor::new(
        &[1, 3, 416, 416],
        super::super::TensorValues::I64(vec![0; 3 * 416 * 416]),
    )
    .unwrap();
    for fed in [
        &[("images", &small)][..],
        &[("images", &empty)],
        &[("images", &whole)],
        &[("pictures", &small)],
        &[],
    ] {
        assert!(matches!(network.run(fed), Err(NnError::Run { .. })));
    }
    assert!(
        Tensor::floats(&[2, 2], vec![0.0; 3]).is_err(),
        "four values are needed"
    );
}
