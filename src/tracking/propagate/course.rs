use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use ostra_masks::{Direction, LabelId, LabelMask, TrackRequest};

/// The walks over all frames of one picture size.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Course {
    /// What anchors of that size show of the labels that are wanted; those that show none of them are left out.
    pub anchors: BTreeMap<usize, Arc<LabelMask>>,
    pub forward: Route,
    pub backward: Route,
}

/// One walk.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Route {
    /// Frames in the order of the walk: anchors that it starts from (for each label the nearest that shows it), then one
    /// frame after the other.
    pub frames: Vec<usize>,
    /// The frames that are to be answered.
    pub targets: BTreeSet<usize>,
}

impl Course {
    /// One for every picture size that an anchor has; second, the frames that were asked for but are of no such size.
    pub fn all(request: &TrackRequest) -> (Vec<Self>, Vec<usize>) {
        let size = |frame: usize| (request.frames[frame].width, request.frames[frame].height);
        let anchors = request
            .anchors
            .iter()
            .filter_map(|(&at, mask)| Some((at, wanted(mask, request.labels.as_ref())?)));
        let mut by_size: BTreeMap<(u32, u32), BTreeMap<usize, Arc<LabelMask>>> = BTreeMap::new();
        anchors.for_each(|(at, mask)| drop(by_size.entry(size(at)).or_default().insert(at, mask)));
        let asked =
            (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame));
        let (asked, others): (BTreeSet<usize>, BTreeSet<usize>) =
            asked.partition(|&at| by_size.contains_key(&size(at)));
        let course = |(of, anchors): ((u32, u32), BTreeMap<usize, Arc<LabelMask>>)| {
            let mut frames: Vec<usize> = (0..request.frames.len())
                .filter(|&frame| size(frame) == of)
                .collect();
            let route = |way, frames: &[usize]| match request.direction {
                direction if direction == way => Route::default(),
                _ => Route::new(frames, &anchors, &asked),
            };
            let forward = route(Direction::Backward, &frames);
            frames.reverse();
            let backward = route(Direction::Forward, &frames);
            Self {
                anchors,
                forward,
                backward,
            }
        };
        (
            by_size.into_iter().map(course).collect(),
            others.into_iter().collect(),
        )
    }

    /// Frames to be walked over.
    pub fn steps(&self) -> usize {
        self.forward.frames.len() + self.backward.frames.len()
    }

    /// How much the walk forwards counts in a frame that both answer, 0–1: all on its anchor, half between two.
    pub fn nearness(&self, frame: usize) -> f32 {
        let before = self
            .anchors
            .range(..frame)
            .next_back()
            .map_or(frame, |(&anchor, _)| frame - anchor);
        let after = self
            .anchors
            .range(frame..)
            .next()
            .map_or(frame, |(&anchor, _)| anchor - frame);
        after as f32 / (before + after).max(1) as f32
    }
}

impl Route {
    /// Along `frames`, to those of the `asked` that come after an anchor.
    fn new(
        frames: &[usize],
        anchors: &BTreeMap<usize, Arc<LabelMask>>,
        asked: &BTreeSet<usize>,
    ) -> Self {
        let mut nearest: BTreeMap<LabelId, usize> = BTreeMap::new();
        let (mut targets, mut ends) = (BTreeSet::new(), (0, 0));
        for (place, frame) in frames.iter().enumerate() {
            match anchors.get(frame) {
                Some(mask) if targets.is_empty() => {
                    nearest.extend(labels(mask).into_iter().map(|label| (label, place)));
                    ends.0 = place;
                }
                None if !nearest.is_empty() && asked.contains(frame) => {
                    targets.insert(*frame);
                    ends.1 = place;
                }
                _ => {}
            }
        }
        if targets.is_empty() {
            return Self::default();
        }
        let starts: BTreeSet<usize> = nearest.into_values().collect();
        let places = starts.into_iter().chain(ends.0 + 1..=ends.1);
        Self {
            frames: places.map(|place| frames[place]).collect(),
            targets,
        }
    }
}

/// The labels that a mask shows.
pub(super) fn labels(mask: &LabelMask) -> BTreeSet<LabelId> {
    let mut last = LabelId::NONE;
    let mut labels = BTreeSet::new();
    for &id in mask.ids.iter().filter(|&&id| id != LabelId::NONE) {
        if std::mem::replace(&mut last, id) != id {
            labels.insert(id);
        }
    }
    labels
}

/// What a mask shows of some labels; `None` where it shows nothing of them.
fn wanted(mask: &Arc<LabelMask>, chosen: Option<&BTreeSet<LabelId>>) -> Option<Arc<LabelMask>> {
    let shown = labels(mask);
    let is_chosen = |id: &LabelId| chosen.is_none_or(|chosen| chosen.contains(id));
    if shown.iter().all(is_chosen) {
        return (!shown.is_empty()).then(|| Arc::clone(mask));
    }
    if !shown.iter().any(is_chosen) {
        return None;
    }
    let ids = mask
        .ids
        .iter()
        .map(|id| if is_chosen(id) { *id } else { LabelId::NONE })
        .collect();
    Some(Arc::new(LabelMask { ids, ..**mask }))
}
