//! Purposes of an export, each of which ticks what it needs.

use super::export_form::{Available, ExportForm};
use ostra_masks::MaskFormat;

/// What is exported together for a purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Preset {
    PlantTraits,
    CocoMasks,
    CloudCompare,
    Everything,
}

impl Preset {
    pub(super) const ALL: [Self; 4] = [
        Self::PlantTraits,
        Self::CocoMasks,
        Self::CloudCompare,
        Self::Everything,
    ];

    pub(super) fn text(self) -> &'static str {
        match self {
            Self::PlantTraits => "Plant traits",
            Self::CocoMasks => "COCO masks",
            Self::CloudCompare => "Labelled cloud for CloudCompare",
            Self::Everything => "Everything",
        }
    }

    pub(super) fn tip(self) -> &'static str {
        match self {
            Self::PlantTraits => "Only traits.csv, a table of traits per label",
            Self::CocoMasks => "Only the masks, as one COCO JSON file",
            Self::CloudCompare => {
                "Only cloud.ply with the labels as a field, and a copy in label colours"
            }
            Self::Everything => "All that this project has",
        }
    }

    /// Returns what the project lacks for this preset.
    pub(super) fn missing(self, has: &Available) -> Option<&'static str> {
        match self {
            Self::PlantTraits | Self::CloudCompare if !has.cloud => Some("Fuse first"),
            Self::CocoMasks if !has.masks => Some("No masks yet"),
            Self::Everything if *has == Available::default() => Some("Nothing to export yet"),
            _ => None,
        }
    }
}

impl ExportForm {
    /// Ticks what a preset exports, and resets the formats; folder and replacing are kept.
    pub(super) fn apply(&mut self, preset: Preset, has: &Available) {
        let all = preset == Preset::Everything;
        *self = Self {
            into: std::mem::take(&mut self.into),
            overwrite: self.overwrite,
            is_suggested: self.is_suggested,
            cloud: (all && has.cloud) || preset == Preset::CloudCompare,
            mesh: all && has.surface,
            voxels: all && has.surface,
            masks: (all && has.masks) || preset == Preset::CocoMasks,
            cameras: all && has.cameras,
            undistorted: all && has.cameras,
            depths: all && has.depths,
            traits: (all && has.cloud) || preset == Preset::PlantTraits,
            twin: preset == Preset::CloudCompare,
            mask_format: if preset == Preset::CocoMasks {
                MaskFormat::Coco
            } else {
                MaskFormat::default()
            },
            ..Self::default()
        };
    }

    /// Returns whether the form is as a preset sets it.
    pub(super) fn is(&self, preset: Preset, has: &Available) -> bool {
        let mut other = self.clone();
        other.apply(preset, has);
        *self == other
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::MeasureView;

    #[test]
    fn presets_tick_what_they_name_and_nothing_that_is_missing() {
        let has = Available {
            cloud: true,
            masks: true,
            cameras: true,
            ..Available::default()
        };
        let mut form = ExportForm {
            into: "/out".into(),
            overwrite: true,
            level: 2,
            ..ExportForm::default()
        };
        let measures = MeasureView::default();
        let mut request = |preset: Preset| {
            assert_eq!(preset.missing(&has), None);
            form.apply(preset, &has);
            assert!(form.is(preset, &has));
            assert!(form.overwrite, "it is not part of a preset");
            form.request(&has, &measures).unwrap()
        };
        let traits = request(Preset::PlantTraits);
        assert_eq!(traits.traits, Some("/out/traits.csv".into()));
        assert_eq!(
            (traits.cloud, traits.masks, traits.level),
            (None, None, None)
        );
        let masks = request(Preset::CocoMasks);
        assert_eq!(masks.mask_format, Some(MaskFormat::Coco));
        assert_eq!((masks.cloud, masks.traits), (None, None));
        let cloud = request(Preset::CloudCompare);
        assert_eq!(cloud.cloud, Some("/out/cloud.ply".into()));
        assert!(cloud.twin && cloud.masks.is_none());
        let all = request(Preset::Everything);
        assert!(all.cloud.is_some() && all.masks.is_some() && all.traits.is_some());
        assert!(all.cameras.is_some() && all.undistorted.is_some());
        assert_eq!((all.mesh, all.voxels, all.depths), (None, None, None));
        let nothing = Available::default();
        assert!(
            Preset::ALL
                .iter()
                .all(|preset| preset.missing(&nothing).is_some())
        );
    }
}
