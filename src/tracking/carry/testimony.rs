use super::viewpoint::Viewpoint;
use super::vote::Votes;
use ostra_masks::LabelId;

/// What anchors say of a frame.
#[derive(Debug)]
pub(crate) struct Testimony {
    /// The frame.
    pub target: Viewpoint,
    /// Its depths, with what anchors show in its holes.
    pub depths: Vec<f32>,
    pub votes: Votes,
}

impl Testimony {
    /// The label of a pixel (0 = nothing) by the anchors that have a surface where the frame has one: it wins at least
    /// `share` of their weights, which sum to at least `weight`. `None` where no label does, and where the frame has no
    /// depth. Nothing being there counts where the anchors would know of the label `held` that the pixel has so far.
    pub fn verdict(&self, pixel: usize, held: LabelId, share: f32, weight: f32) -> Option<LabelId> {
        if self.target.depth.depths[pixel] <= 0.0 {
            return None;
        }
        let is_sure = |label: LabelId, shown: LabelId| {
            let [own, all] = self.votes.at(pixel, label, shown);
            all >= weight && own >= share * all
        };
        let seen = self
            .votes
            .of_anchors
            .iter()
            .filter_map(|(_, sightings)| Some(sightings.at(pixel)?.0));
        let named = seen
            .filter(|&label| label != LabelId::NONE)
            .find(|&label| is_sure(label, label));
        named.or_else(|| is_sure(held, LabelId::NONE).then_some(LabelId::NONE))
    }

    /// Whether an anchor sees through the place of a pixel's surface, and none has it where the frame does: something came
    /// there.
    pub fn is_new(&self, pixel: usize) -> bool {
        let sightings = || self.votes.of_anchors.iter().map(|(_, sightings)| sightings);
        sightings().any(|seen| seen.is_through(pixel))
            && sightings().all(|seen| seen.at(pixel).is_none())
    }
}
