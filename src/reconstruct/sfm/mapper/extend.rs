//! Placing further images in a model that stands.

use super::grow::Mapped;
use super::state::Mapper;
use super::{MapperOptions, Refusal};
use crate::sfm::{Correspondences, MapProblem};
use ostra_core::job::{Progress, Stopped};
use std::collections::BTreeMap;

/// Places images in a standing model, for which matches were found after it was made.
///
/// `problem` is that of the model with further matches and, in images that are in no model, further
/// keypoints. Images of the other models in `models`, of which the first is extended, stay out.
///
/// Returns `None` if no image can be placed. The model is then as good as it was.
///
/// # Errors
/// [`Stopped`]
pub fn extend(
    problem: &MapProblem,
    models: &[Mapped],
    options: &MapperOptions,
    progress: &Progress,
) -> Result<Option<Mapped>, Stopped> {
    let Some((standing, others)) = models.split_first() else {
        return Ok(None);
    };
    let links = Correspondences::new(problem);
    let mut mapper = Mapper::new(problem, &links, options, progress);
    for other in others {
        for image in other.model.placed() {
            mapper.closed[image as usize] = true;
        }
    }
    mapper.adopt(&standing.model);
    let before = standing.model.placed().count();
    let refused = mapper.place_more(refused_before(standing, &mapper))?;
    let grown = mapper.model.placed().count() > before;
    Ok(grown.then(|| Mapped {
        contradiction: mapper.contradiction(),
        model: mapper.model,
        start: standing.start,
        refused,
        stopped: standing.stopped,
    }))
}

/// Returns the images that were refused and see no more of the model than then: it would be the same again.
fn refused_before(standing: &Mapped, mapper: &Mapper<'_>) -> BTreeMap<u32, Refusal> {
    let sees_more = |image: u32, refusal: &Refusal| mapper.supported(image) > refusal.seen;
    let mut refused = standing.refused.clone();
    refused.retain(|&image, refusal| !sees_more(image, refusal));
    refused
}
