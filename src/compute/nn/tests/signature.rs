use super::super::{Element, Port, Signature};

fn port(name: &str, element: Element, shape: &[i64]) -> Port {
    Port {
        name: name.to_owned(),
        element,
        shape: shape
            .iter()
            .map(|&size| usize::try_from(size).ok())
            .collect(),
    }
}

fn signature(input: &[i64], output: &[i64]) -> Signature {
    let outputs = vec![port("out", Element::I64, output)];
    Signature {
        inputs: vec![port("in", Element::F32, input)],
        outputs,
    }
}

#[test]
fn open_sizes_of_a_network_fit() {
    let expected = signature(&[1, 3, -1], &[-1, 2]);
    assert_eq!(expected.fits(&signature(&[-1, 3, -1], &[100, 2])), Ok(()));
    assert_eq!(
        expected.fits(&signature(&[], &[])),
        Ok(()),
        "the number of dimensions is unknown"
    );
}

#[test]
fn input_of_fixed_size_does_not_fit_any_size() {
    let expected = signature(&[1, 3, -1], &[-1, 2]);
    let error = expected
        .fits(&signature(&[1, 3, 640], &[-1, 2]))
        .unwrap_err();
    assert_eq!(
        error,
        "expected the input `in` f32 [1, 3, any], there is `in` f32 [1, 3, 640]"
    );
}

#[test]
fn different_sizes_elements_and_names_are_reported() {
    let expected = signature(&[1, 3], &[2]);
    assert!(
        expected
            .fits(&signature(&[1, 4], &[2]))
            .unwrap_err()
            .contains("[1, 4]")
    );
    assert!(
        expected.fits(&signature(&[1, 3, 1], &[2])).is_err(),
        "a dimension more"
    );
    let mut other = signature(&[1, 3], &[2]);
    other.outputs[0].element = Element::F32;
    assert!(
        expected
            .fits(&other)
            .unwrap_err()
            .contains("the output `out` i64 [2], there is `out` f32 [2]")
    );
    other.outputs[0].name = "result".to_owned();
    assert!(
        expected
            .fits(&other)
            .unwrap_err()
            .contains("there is `result`")
    );
}

#[test]
fn additional_outputs_fit_and_additional_inputs_do_not() {
    let expected = signature(&[1], &[1]);
    let mut found = expected.clone();
    found.outputs.push(port("more", Element::F32, &[1]));
    assert_eq!(expected.fits(&found), Ok(()));
    found.inputs.push(port("more", Element::F32, &[1]));
    assert!(
        expected.fits(&found).unwrap_err().contains("`more`"),
        "it would never be fed"
    );
}
