//! Runs of a mask as one short string, `WIDTHxHEIGHT ID*LENGTH ID*LENGTH …`: the journal's form, which a person can
//! read.

use std::fmt::Write;
use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serializer, de::Error};

use ostra_masks::{LabelId, MaskError, RunMask};

/// Writes the runs.
pub fn serialize<S: Serializer>(mask: &Arc<RunMask>, serializer: S) -> Result<S::Ok, S::Error> {
    let mut text = format!("{}x{}", mask.width, mask.height);
    for (id, length) in &mask.runs {
        // Writing to a string cannot fail.
        let _ = write!(text, " {}*{length}", id.0);
    }
    serializer.serialize_str(&text)
}

/// Reads runs that [`serialize`] wrote.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Arc<RunMask>, D::Error> {
    let text = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
    let damaged = || D::Error::custom("the runs of a mask are damaged");
    parse(&text)
        .ok_or_else(damaged)?
        .map(Arc::new)
        .map_err(D::Error::custom)
}

/// The mask in a text of the right form; the inner error is that of [`RunMask::new`].
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
