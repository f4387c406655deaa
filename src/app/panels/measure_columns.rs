/// A column of the table of measures.
pub(super) struct Column {
    pub(super) title: &'static str,
    pub(super) tip: &'static str,
    /// Traits that it shows.
    pub(super) traits: &'static [&'static str],
    /// Whether all of them are shown, or the first that the label has.
    pub(super) joined: bool,
}

const fn first(title: &'static str, tip: &'static str, traits: &'static [&'static str]) -> Column {
    Column {
        title,
        tip,
        traits,
        joined: false,
    }
}

const fn joined(title: &'static str, tip: &'static str, traits: &'static [&'static str]) -> Column {
    Column {
        title,
        tip,
        traits,
        joined: true,
    }
}

/// After the label's name, from left to right.
pub(super) const COLUMNS: [Column; 12] = [
    first(
        "Points",
        "Points of the label and those below it",
        &["points"],
    ),
    first(
        "Pieces",
        "Groups of points that hang together",
        &["instances"],
    ),
    first("Length", "Along the middle line", &["length"]),
    first(
        "Width",
        "Mean width of a sheet, median diameter of a rod",
        &["width", "diameter"],
    ),
    first(
        "Widest",
        "Largest width or diameter, without the broadest 5 %",
        &["width_max", "diameter_max"],
    ),
    first("Area", "Area of the surface", &["area"]),
    first("Hull", "Volume of the convex hull", &["hull_volume"]),
    first("Volume", "Volume by voxels", &["voxel_volume"]),
    first(
        "Height",
        "Of the highest point above the ground",
        &["height_max"],
    ),
    first(
        "Insertion",
        "Angle between a sheet and the rod that it leaves",
        &["insertion_angle"],
    ),
    joined(
        "Oriented box",
        "Sizes along the principal axes",
        &["size_long", "size_middle", "size_short"],
    ),
    joined(
        "Box",
        "Sizes along the axes x, y, z of the world",
        &["box_x", "box_y", "box_z"],
    ),
];
