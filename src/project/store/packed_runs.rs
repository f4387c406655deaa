//! Human-readable string for the runs of a mask: `WIDTHxHEIGHT ID*LENGTH ID*LENGTH …`.
//!
//! The journal uses this form.

use std::fmt::Write;
use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serializer, de::Error};

use ostra_masks::{LabelId, MaskError, RunMask};

/// Serializes the runs.
pub fn serialize<S: Serializer>(mask: &Arc<RunMask>, serializer: S) -> Result<S::Ok, S::Error> {
    let mut text = format!("{}x{}", mask.width, mask.height);
    for (id, length) in &mask.runs {
        // Writing to a string cannot fail.
        let _ = write!(text, " {}*{length}", id.0);
    }
    serializer.serialize_str(&text)
}

/// Deserializes runs that [`serialize`] wrote.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Arc<RunMask>, D::Error> {
    let text = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
    let damaged = || D::Error::custom("the runs of a mask are damaged");
    parse(&text)
        .ok_or_else(damaged)?
        .map(Arc::new)
        .map_err(D::Error::custom)
}

/// Parses a mask, or returns `None` if the text does not have the right form.
///
/// The inner error is that of [`RunMask::new`].
fn parse(text: &str) -> Option<Result<RunMask, MaskError>> {
    let mut words = text.split(' ');
    let (width, height) = words.next()?.split_once('x')?;
    let runs = words.map(|word| {
        let (id, length) = word.split_once('*')?;
        Some((LabelId(id.parse().ok()?), length.parse().ok()?))
    });
    Some(RunMask::new(
        width.parse().ok()?,
        height.parse().ok()?,
        runs.collect::<Option<_>>()?,
    ))
}
