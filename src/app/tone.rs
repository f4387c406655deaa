//! Brightness and contrast of the shown image.

/// Change of the shown image. Files, masks and engines never see it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tone {
    /// Brightness, -1 to 1; 0 changes nothing. Black stays black and white stays white.
    pub brightness: f32,
    /// Contrast around the middle grey, -1 to 1; 0 changes nothing.
    pub contrast: f32,
}

impl Tone {
    /// Returns the shown value of each value of a colour channel.
    pub(super) fn table(self) -> [u8; 256] {
        let gamma = 4f32.powf(-self.brightness.clamp(-1.0, 1.0));
        let slope = 4f32.powf(self.contrast.clamp(-1.0, 1.0));
        std::array::from_fn(|value| {
            if self == Self::default() {
                return value as u8;
            }
            let bright = (value as f32 / 255.0).powf(gamma);
            let shown = (bright - 0.5) * slope + 0.5;
            (shown.clamp(0.0, 1.0) * 255.0).round() as u8
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_changes_by_default() {
        let table = Tone::default().table();
        assert!((0..=255).all(|value| table[usize::from(value)] == value));
    }

    #[test]
    fn brightness_lifts_dark_values_and_contrast_spreads_them() {
        let bright = Tone {
            brightness: 0.5,
            contrast: 0.0,
        };
        let table = bright.table();
        assert!(table[40] > 90 && table[0] == 0 && table[255] == 255);
        let strong = Tone {
            brightness: 0.0,
            contrast: 0.5,
        };
        let table = strong.table();
        assert!(table[150] - table[100] > 90);
        let weak = Tone {
            brightness: 0.0,
            contrast: -1.0,
        };
        assert!(weak.table()[255] - weak.table()[0] < 70);
        for table in [bright.table(), strong.table(), weak.table()] {
            assert!(table.is_sorted(), "the order of values is kept");
        }
    }
}
