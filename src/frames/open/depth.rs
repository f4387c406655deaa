use std::path::Path;

use super::listing::Listed;
use super::pairing::{Pairs, pair_by_name};
use super::request::OpenRequest;
use super::source::Item;
use super::tum::{pair_by_associations, pair_by_time, times_of};
use crate::FrameError;

/// Decides which depth belongs to which picture: by `associations.txt` at `places` or above them, by the times that
/// names are, or by name and number.
pub(super) fn pair(
    pictures: &[Listed],
    depths: &[Listed],
    places: &[&Path],
    warnings: &mut Vec<String>,
) -> Result<Pairs, FrameError> {
    let mut pairs = Pairs::none(pictures.len(), depths.len());
    if let (&[_], &[_]) = (pictures, depths) {
        pairs.join(0, 0);
        return Ok(pairs);
    }
    let folders: Vec<&Path> = places
        .iter()
        .flat_map(|place| [Some(*place), place.parent()])
        .flatten()
        .collect();
    if let Some(list) = pair_by_associations(&mut pairs, &folders, pictures, depths)? {
        if pairs.count() > 0 {
            return Ok(pairs);
        }
        warnings.push(format!(
            "{}: names none of these pictures; depth is paired by name",
            list.display()
        ));
    }
    let (pictures, depths) = (names(pictures), names(depths));
    if !pair_by_time(&mut pairs, &pictures, &depths) {
        pair_by_name(&mut pairs, &pictures, &depths);
    }
    Ok(pairs)
}

/// Puts the paired depths into the pictures they belong to.
pub(super) fn with_depth(items: Vec<Item>, depths: &[Listed], pairs: &Pairs) -> Vec<Item> {
    let one = |(item, depth): (Item, &Option<usize>)| Item {
        depth: depth.map(|at| depths[at].path.clone()),
        ..item
    };
    items.into_iter().zip(&pairs.depth_of).map(one).collect()
}

/// TUM recordings, whose names are times, have their own depth unit.
pub(super) fn warn_of_tum_unit(pictures: &[Listed], depth_unit: f64) -> Option<String> {
    let usual = depth_unit.to_bits() == OpenRequest::default().depth_unit.to_bits();
    (usual && times_of(&names(pictures)).is_some()).then(|| {
        "the names are times, as in TUM recordings, whose depth has 5000 steps a metre: give --depth-unit 0.0002 if this \
         is one (now 0.001)"
            .into()
    })
}

fn names(listed: &[Listed]) -> Vec<&str> {
    listed.iter().map(|file| file.name.as_str()).collect()
}
