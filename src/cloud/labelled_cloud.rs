use ostra_masks::{Label, LabelId, LabelTree};

/// Points with colour, normal, label and confidence. All vectors have the same length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LabelledCloud {
    /// Positions in world units, relative to `origin`.
    pub positions: Vec<glam::Vec3>,
    /// Unit normals towards the cameras; zero is unknown.
    pub normals: Vec<glam::Vec3>,
    /// Colours in sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Labels that won the vote; 0 is unlabelled.
    pub labels: Vec<LabelId>,
    /// Share of the votes for the winning label, 0–1.
    pub confidence: Vec<f32>,
    /// Names, colours and parents of the labels.
    pub tree: LabelTree,
    /// Global coordinates of the origin that positions are relative to; zero if they are global.
    pub origin: glam::DVec3,
}

/// Colour (sRGB) of unlabelled points in a cloud with label colours.
pub const UNLABELLED_COLOR: [u8; 3] = [128, 128, 128];

impl LabelledCloud {
    /// Returns the number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Creates a cloud from positions only: grey, without normals and labels.
    #[must_use]
    pub fn from_positions(positions: Vec<glam::Vec3>) -> Self {
        let count = positions.len();
        Self {
            positions,
            normals: vec![glam::Vec3::ZERO; count],
            colors: vec![[192; 3]; count],
            labels: vec![LabelId::NONE; count],
            confidence: vec![0.0; count],
            tree: LabelTree::default(),
            origin: glam::DVec3::ZERO,
        }
    }

    /// Makes the positions relative to another origin, without moving the points.
    pub fn move_origin(&mut self, origin: glam::DVec3) {
        let by = self.origin - origin;
        if by != glam::DVec3::ZERO {
            self.positions
                .iter_mut()
                .for_each(|at| *at = (at.as_dvec3() + by).as_vec3());
        }
        self.origin = origin;
    }

    /// Returns whether a point was voted on and its label won less than a share (0–1) of the votes.
    #[must_use]
    pub fn is_uncertain(&self, point: usize, below: f32) -> bool {
        (f32::MIN_POSITIVE..below).contains(&self.confidence[point])
    }

    /// Returns the points with these indices, in the given order, with the same tree.
    ///
    /// Indices beyond the end are ignored.
    #[must_use]
    pub fn select(&self, indices: &[u32]) -> Self {
        fn pick<T: Copy>(from: &[T], indices: &[u32]) -> Vec<T> {
            indices
                .iter()
                .filter_map(|&index| from.get(index as usize).copied())
                .collect()
        }
        Self {
            positions: pick(&self.positions, indices),
            normals: pick(&self.normals, indices),
            colors: pick(&self.colors, indices),
            labels: pick(&self.labels, indices),
            confidence: pick(&self.confidence, indices),
            tree: self.tree.clone(),
            origin: self.origin,
        }
    }

    /// Multiplies all global positions, including the origin, by a factor above 0.
    pub fn scale_by(&mut self, factor: f64) {
        self.origin *= factor;
        for position in &mut self.positions {
            *position = (position.as_dvec3() * factor).as_vec3();
        }
    }

    /// Adds an unlabelled point without a normal.
    pub fn push(&mut self, position: glam::Vec3, color: [u8; 3]) {
        self.positions.push(position);
        self.normals.push(glam::Vec3::ZERO);
        self.colors.push(color);
        self.labels.push(LabelId::NONE);
        self.confidence.push(0.0);
    }

    /// Adds all points of another cloud; the tree is unchanged.
    pub fn append(&mut self, other: &Self) {
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.colors.extend_from_slice(&other.colors);
        self.labels.extend_from_slice(&other.labels);
        self.confidence.extend_from_slice(&other.confidence);
    }

    /// Adds a copy of another cloud's point at another position and with another normal.
    pub(crate) fn push_copy(
        &mut self,
        from: &Self,
        point: usize,
        position: glam::Vec3,
        normal: glam::Vec3,
    ) {
        self.positions.push(position);
        self.normals.push(normal);
        self.colors.push(from.colors[point]);
        self.labels.push(from.labels[point]);
        self.confidence.push(from.confidence[point]);
    }

    /// Adds the mean of some points with a label and the minimum of their confidences.
    ///
    /// Returns the index of the new point.
    pub(crate) fn push_mean(&mut self, of: &[u32], label: LabelId) -> u32 {
        let share = 1.0 / of.len() as f32;
        let points = || of.iter().map(|&point| point as usize);
        self.positions.push(
            points()
                .map(|point| self.positions[point])
                .sum::<glam::Vec3>()
                * share,
        );
        self.normals.push(
            points()
                .map(|point| self.normals[point])
                .sum::<glam::Vec3>()
                .normalize_or_zero(),
        );
        let channel = |at: usize| {
            points()
                .map(|point| f32::from(self.colors[point][at]))
                .sum::<f32>()
                * share
        };
        self.colors
            .push([0, 1, 2].map(|at| channel(at).round() as u8));
        self.labels.push(label);
        self.confidence.push(
            points()
                .map(|point| self.confidence[point])
                .fold(1.0, f32::min),
        );
        self.len() as u32 - 1
    }

    /// Returns the cloud with every label replaced by its ancestor at `level` (1 = top).
    ///
    /// The tree is unchanged.
    #[must_use]
    pub fn at_level(&self, level: usize) -> Self {
        let mut cloud = self.clone();
        let coarse = level_table(&self.tree, level);
        for id in &mut cloud.labels {
            *id = coarse.get(usize::from(id.0)).copied().unwrap_or(*id);
        }
        cloud
    }

    /// Returns the label colour of each point; [`UNLABELLED_COLOR`] for unlabelled points.
    #[must_use]
    pub fn label_colors(&self) -> Vec<[u8; 3]> {
        let mut table = vec![UNLABELLED_COLOR; usize::from(u16::MAX) + 1];
        for label in self.tree.iter() {
            table[usize::from(label.id.0)] = label.color;
        }
        self.labels
            .iter()
            .map(|id| table[usize::from(id.0)])
            .collect()
    }
}

/// Returns the ancestor at `level` for every id up to the largest one of the tree.
fn level_table(tree: &LabelTree, level: usize) -> Vec<LabelId> {
    let last = tree.iter().last().map_or(0, |label| label.id.0);
    (0..=last)
        .map(|id| tree.at_level(LabelId(id), level))
        .collect()
}

/// Adds a top-level label named after its number for every id that the tree lacks.
pub(crate) fn name_unknown_labels(tree: &mut LabelTree, ids: impl IntoIterator<Item = LabelId>) {
    for id in ids {
        if id == LabelId::NONE || tree.get(id).is_some() {
            continue;
        }
        let mut name = id.0.to_string();
        while tree.by_name(&name).is_some() {
            name.push('\'');
        }
        let label = Label {
            id,
            name,
            color: LabelTree::color_for(id),
            parent: None,
        };
        // A new top-level label with a free name breaks no invariant of the tree.
        let _ = tree.set(label);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(id: u16, name: &str, parent: Option<u16>) -> Label {
        Label {
            id: LabelId(id),
            name: name.into(),
            color: [id as u8; 3],
            parent: parent.map(LabelId),
        }
    }

    #[test]
    fn at_level_and_select_pick_labels_and_points() {
        let mut cloud =
            LabelledCloud::from_positions(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y]);
        cloud.tree.set(label(1, "plant", None)).unwrap();
        cloud.tree.set(label(2, "leaf", Some(1))).unwrap();
        cloud.labels = vec![LabelId(2), LabelId(0), LabelId(9)];
        assert_eq!(
            cloud.at_level(1).labels,
            [LabelId(1), LabelId(0), LabelId(9)]
        );
        assert_eq!(
            cloud.label_colors(),
            [[2; 3], UNLABELLED_COLOR, UNLABELLED_COLOR]
        );
        let picked = cloud.select(&[2, 7, 0]);
        assert_eq!(picked.positions, [glam::Vec3::Y, glam::Vec3::ZERO]);
        assert_eq!(picked.labels, [LabelId(9), LabelId(2)]);
    }

    #[test]
    fn unknown_ids_get_free_names() {
        let mut tree = LabelTree::default();
        tree.set(label(1, "7", None)).unwrap();
        name_unknown_labels(&mut tree, [LabelId(0), LabelId(7), LabelId(7), LabelId(1)]);
        assert_eq!(tree.iter().count(), 2);
        assert_eq!(tree.get(LabelId(7)).unwrap().name, "7'");
    }
}
