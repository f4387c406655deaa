use crate::scene::stereo::patchmatch::{MAX_SOURCES, constants};

/// Sizes of arrays cannot be handed to a program; they are stated in it again.
#[test]
fn sizes_of_arrays_are_those_of_the_processor() {
    let program = include_str!("../shaders/patchmatch/data.wgsl");
    let sizes =
        [("MAX_SOURCES", MAX_SOURCES), ("COMPARED", constants::COMPARED), ("QUARTERS", constants::TAPS.div_ceil(4))];
    for (name, size) in sizes {
        assert!(program.contains(&format!("const {name}: u32 = {size}u;")), "{name} is {size}");
    }
}
