//! GPU tests of computing: pieces of work, errors, limits.

use std::ops::Range;

use ostra_compute::gpu::{Binding, Device, GpuError, Pieces, Software, WorkSize};

const SQUARES: &str = "
@group(0) @binding(0) var<uniform> rows: vec2u;
@group(0) @binding(1) var<storage, read> numbers: array<u32>;
@group(0) @binding(2) var<storage, read_write> squares: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let row = rows.x + id.y;
    if row < rows.y && id.x < 300u {
        squares[row * 300u + id.x] += numbers[row * 300u + id.x] * numbers[row * 300u + id.x];
    }
}";

fn device() -> Device {
    Device::open(Software::Allowed).unwrap()
}

/// Squares 300 × 1001 numbers piece by piece; returns the squares and the pieces.
fn squares(device: &Device, stop_after: usize) -> Result<(Vec<u32>, Vec<Range<u32>>), GpuError> {
    let program = device.program(
        "squares",
        SQUARES,
        &[Binding::Uniform, Binding::Read, Binding::ReadWrite],
    )?;
    let kernel = device.kernel(&program, "main")?;
    let numbers: Vec<u32> = (0..300 * 1001).map(|number| number % 1000).collect();
    let (numbers, results) = (
        device.upload("numbers", &numbers)?,
        device.zeros::<u32>("squares", 300 * 1001)?,
    );
    let rows = device.uniform("rows", &[0u32; 2])?;
    let bindings = device.bind(&program, &[&rows, &numbers, &results])?;
    let mut pieces = Vec::new();
    let submit = |range: Range<u32>| {
        device.write(&rows, 0, &[range.start, range.end])?;
        let groups = [300u32.div_ceil(8), (range.end - range.start).div_ceil(8)];
        pieces.push(range);
        device.submit(&kernel, &bindings, groups)
    };
    let mut checks = 0;
    let check = || {
        checks += 1;
        if checks > stop_after {
            Err(GpuError::NoAdapter)
        } else {
            Ok(())
        }
    };
    let size = WorkSize {
        width: 300,
        rows: 1001,
        grain: 8,
    };
    Pieces::default().run(device, size, submit, check)?;
    Ok((device.read(&results, 300 * 1001)?, pieces))
}

fn every_row_is_computed_once_for_any_pieces() {
    let device = device();
    let (squares, pieces) = squares(&device, usize::MAX).unwrap();
    assert!(
        (0..)
            .zip(&squares)
            .all(|(number, &square): (u32, _)| square == (number % 1000).pow(2))
    );
    assert!(pieces.len() > 3 && pieces[0].len() < 100, "{pieces:?}");
    assert!(
        pieces.windows(2).all(|pair| pair[0].end == pair[1].start)
            && pieces[pieces.len() - 1].end == 1001
    );
}

fn work_stops_between_two_pieces() {
    let device = device();
    assert_eq!(squares(&device, 2).unwrap_err(), GpuError::NoAdapter);
    assert!(
        squares(&device, usize::MAX).is_ok(),
        "the device can be used again"
    );
}

fn invalid_program_is_an_error() {
    let device = device();
    let error = device
        .program("wrong", "fn main() { return 1; }", &[])
        .unwrap_err();
    assert!(matches!(&error, GpuError::Failed { .. }), "{error}");
}

fn wrong_bindings_are_an_error() {
    let device = device();
    let program = device
        .program(
            "squares",
            SQUARES,
            &[Binding::Read, Binding::Read, Binding::ReadWrite],
        )
        .unwrap();
    assert!(device.kernel(&program, "main").is_err());
}

fn oversized_buffer_error_names_the_buffer() {
    let device = device();
    let error = device.zeros::<u32>("pixels", (32 << 20) + 1).unwrap_err();
    assert!(matches!(error, GpuError::TooLarge { what: "pixels", .. }));
    assert!(
        error
            .to_string()
            .starts_with("pixels need 129 MiB in one buffer, and a graphics card takes 128 MiB")
    );
    assert_eq!(
        device.zeros::<u32>("pixels", 32 << 20).unwrap().bytes(),
        128 << 20
    );
}

fn software_adapter_is_used_only_if_allowed() {
    let device = device();
    match Device::open(Software::Refused) {
        Ok(real) => assert!(!real.is_software()),
        Err(error) => assert!(
            device.is_software() && matches!(error, GpuError::SoftwareOnly { .. }),
            "{error}"
        ),
    }
}

crate::tests! {
    every_row_is_computed_once_for_any_pieces,
    work_stops_between_two_pieces,
    invalid_program_is_an_error,
    wrong_bindings_are_an_error,
    oversized_buffer_error_names_the_buffer,
    software_adapter_is_used_only_if_allowed
}
