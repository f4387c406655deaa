//! Exclude clicks for a network that knows none: of its masks one that leaves them out is taken, and where none does, what
//! a click on that place would find is taken away.

use super::decoder::Answer;
use super::frame::SamFrame;
use crate::{Click, MaskError, PxBox};

impl SamFrame {
    /// The mask for clicks and a box; `before`, less what is outside, where that is from elsewhere and holds all that is
    /// to be inside.
    pub(super) fn heed(
        &self,
        clicks: &[Click],
        within: Option<&PxBox>,
        before: Option<&Answer>,
    ) -> Result<Answer, MaskError> {
        let holds_all =
            |answer: &&Answer| self.obeyed(answer, clicks, true) == includes(clicks).count();
        let found = match before.filter(|before| before.is_given).filter(holds_all) {
            Some(before) => vec![before.clone()],
            None => self.masks(clicks, within)?.others,
        };
        let none = || MaskError::Network("the network gives no mask".into());
        let mut answer = self.most_heeding(found, clicks).ok_or_else(none)?;
        for click in clicks.iter().filter(|click| !click.include) {
            if self.logit_at(&answer, click) > 0.0
                && let Some(other) = self.excluded(click, clicks, &answer)?
            {
                let logits = answer.logits.iter_mut().zip(&other.logits);
                logits.for_each(|(logit, other)| *logit = logit.min(-other));
            }
        }
        Ok(answer)
    }

    /// Of several masks the one that holds most of what is to be inside, of equal ones that which leaves out most of what
    /// is to be outside, of equal ones the surest.
    fn most_heeding(&self, found: Vec<Answer>, clicks: &[Click]) -> Option<Answer> {
        let ranked = found.into_iter().map(|answer| {
            (
                [true, false].map(|kind| self.obeyed(&answer, clicks, kind)),
                answer,
            )
        });
        let better = |a: &([usize; 2], Answer), b: &([usize; 2], Answer)| {
            b.0.cmp(&a.0).then(b.1.score.total_cmp(&a.1.score))
        };
        ranked.min_by(better).map(|(_, answer)| answer)
    }

    /// How many clicks of a kind an answer obeys.
    fn obeyed(&self, answer: &Answer, clicks: &[Click], include: bool) -> usize {
        let of_kind = clicks.iter().filter(|click| click.include == include);
        of_kind
            .filter(|click| (self.logit_at(answer, click) > 0.0) == include)
            .count()
    }

    /// What lies at an exclude click, holds no include click, and is no more than half of the answer.
    fn excluded(
        &self,
        at: &Click,
        clicks: &[Click],
        answer: &Answer,
    ) -> Result<Option<Answer>, MaskError> {
        let at = Click {
            include: true,
            ..*at
        };
        let mut found = self.masks_at(at)?;
        found.retain(|other| {
            let is_in = |click: &Click| self.logit_at(other, click) > 0.0;
            let inside = answer
                .logits
                .iter()
                .zip(&other.logits)
                .filter(|(answer, _)| **answer > 0.0);
            let taken = inside.clone().filter(|(_, other)| **other > 0.0).count();
            is_in(&at) && !includes(clicks).any(is_in) && 2 * taken <= inside.count()
        });
        Ok(self.most_heeding(found, &[at]))
    }
}

fn includes(clicks: &[Click]) -> impl Iterator<Item = &Click> {
    clicks.iter().filter(|click| click.include)
}
