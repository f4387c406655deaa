use crate::{Connectivity, MaskError, Region, components, squared_distance_to};

/// Share of a component's pixels from which the whole component goes to one side.
const WHOLE_SHARE: f64 = 0.9;

/// Returns the part of `whole` that lies nearer to `part` than to `rest`.
///
/// This transfers the cut of an object on one frame to the next frame. A component that lies almost
/// entirely on one side goes to that side as a whole.
///
/// # Errors
/// [`MaskError::Request`] when the regions differ in size.
pub fn nearer_part(whole: &Region, part: &Region, rest: &Region) -> Result<Region, MaskError> {
    part.check_size(whole.width, whole.height)?;
    rest.check_size(whole.width, whole.height)?;
    if part.is_empty() {
        return Ok(Region::empty(whole.width, whole.height));
    }
    let (to_part, to_rest) = (squared_distance_to(part), squared_distance_to(rest));
    let mut nearer = whole.clone();
    for (at, inside) in nearer.inside.iter_mut().enumerate() {
        *inside &= to_part[at] < to_rest[at];
    }
    let pieces = components(whole, Connectivity::Eight);
    let mut taken = vec![0usize; pieces.areas.len()];
    for (&piece, _) in pieces
        .labels
        .iter()
        .zip(&nearer.inside)
        .filter(|(_, inside)| **inside)
    {
        taken[piece as usize - 1] += 1;
    }
    let shares: Vec<f64> = taken
        .iter()
        .zip(&pieces.areas)
        .map(|(&taken, &area)| taken as f64 / area as f64)
        .collect();
    for (inside, &piece) in nearer
        .inside
        .iter_mut()
        .zip(&pieces.labels)
        .filter(|(_, piece)| **piece > 0)
    {
        let share = shares[piece as usize - 1];
        *inside = share >= WHOLE_SHARE || (*inside && share > 1.0 - WHOLE_SHARE);
    }
    Ok(nearer)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(text: &str) -> Region {
        Region {
            width: text.len() as u32,
            height: 1,
            inside: text.bytes().map(|sign| sign == b'#').collect(),
        }
    }

    #[test]
    fn components_go_to_the_nearer_part() {
        let cut = |whole, part, rest| nearer_part(&row(whole), &row(part), &row(rest)).unwrap();
        let nothing = "..............";
        assert_eq!(
            cut(".####...####..", "..####........", "........####.."),
            row(".####.........")
        );
        assert_eq!(
            cut(".##########...", "..####........", "......####...."),
            row(".#####........"),
            "joined: cut between"
        );
        assert_eq!(
            cut(".####.........", "..####........", nothing),
            row(".####.........")
        );
        assert_eq!(
            cut(".####.........", nothing, "..####........"),
            row(nothing)
        );
    }

    #[test]
    fn sliver_on_the_other_side_goes_with_its_component() {
        let (whole, part) = (row("####################"), row("##################.."));
        let rest = row("...................#");
        assert_eq!(nearer_part(&whole, &part, &rest).unwrap(), whole);
    }
}
