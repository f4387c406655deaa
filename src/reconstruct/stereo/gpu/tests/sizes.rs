use crate::stereo::gpu::engine::GROUP;
use crate::stereo::patchmatch::{MAX_SOURCES, constants};

/// Sizes of arrays and groups cannot be passed to a program; they are defined in it again.
#[test]
fn sizes_equal_those_of_the_processor() {
    let program = include_str!("../shaders/patchmatch/data.wgsl");
    let sizes = [
        ("MAX_SOURCES", MAX_SOURCES),
        ("COMPARED", constants::COMPARED),
        ("QUARTERS", constants::TAPS.div_ceil(4)),
    ];
    for (name, size) in sizes {
        assert!(
            program.contains(&format!("const {name}: u32 = {size}u;")),
            "{name} is {size}"
        );
    }
    for program in [
        include_str!("../shaders/patchmatch/entry.wgsl"),
        include_str!("../shaders/enlarge.wgsl"),
    ] {
        let (groups, all) = (
            format!("@workgroup_size({GROUP}, {GROUP})"),
            "@workgroup_size(",
        );
        assert_eq!(
            program.matches(&groups).count(),
            program.matches(all).count()
        );
    }
}
