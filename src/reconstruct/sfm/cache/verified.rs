//! The geometry of two views, computed once for the same matches.

use glam::DVec2;
use sha2::Digest;

use super::FeatureCache;
use super::entries::VerifiedMatches;
use super::format::Key;
use super::keys::begun;
use ostra_geometry::{Camera, TwoViewOptions, estimate_two_view};

/// Estimates the geometry of two views as [`estimate_two_view`], or takes it from a cache.
///
/// The key has all that the result depends on. In a set of images without much overlap, most of the
/// time goes to pairs without a geometry; these are kept as well.
#[must_use]
pub fn verified_matches(
    cache: Option<&FeatureCache>,
    cameras: [&Camera; 2],
    calibrated: bool,
    matches_px: &[[DVec2; 2]],
    options: &TwoViewOptions,
) -> Option<VerifiedMatches> {
    let compute = || {
        let found = estimate_two_view(cameras, calibrated, matches_px, options)?;
        Some(VerifiedMatches {
            inliers: found.inliers,
            kind: found.kind,
            second_from_first: found.second_from_first,
            parallax: found.parallax,
        })
    };
    // Too few matches are refused at once.
    let Some(cache) = cache.filter(|_| matches_px.len() >= options.min_inliers) else {
        return compute();
    };
    let key = key(cameras, calibrated, matches_px, options);
    if let Some(known) = cache.verified(&key) {
        let last = known.as_ref().and_then(|known| known.inliers.last());
        if last.is_none_or(|&last| (last as usize) < matches_px.len()) {
            return known;
        }
        cache.note_damage();
    }
    let found = compute();
    cache.keep_verified(key, found.clone());
    found
}

fn key(
    cameras: [&Camera; 2],
    calibrated: bool,
    matches_px: &[[DVec2; 2]],
    options: &TwoViewOptions,
) -> Key {
    let mut digest = begun(&[env!("CARGO_PKG_VERSION"), "two views"]);
    // Numbers are printed so that they are read back as the same bits.
    digest.update(format!("{cameras:?} {calibrated} {options:?}"));
    let values = matches_px.as_flattened().iter().flat_map(DVec2::to_array);
    let bytes: Vec<u8> = values.flat_map(f64::to_le_bytes).collect();
    digest.update(bytes);
    digest.finalize().into()
}
