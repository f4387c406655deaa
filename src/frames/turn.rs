use super::Orientation;

/// Where the shown pixel (x, y) lies in the stored rows: `base + x · step_x + y · step_y`.
struct Steps {
    base: usize,
    step_x: isize,
    step_y: isize,
}

/// Side of the blocks in which a picture is turned, so that both sides of the copy stay in the processor's cache.
const BLOCK: usize = 32;

impl Orientation {
    /// Whether width and height of the shown picture are those of the stored one exchanged.
    #[must_use]
    pub fn swaps_sides(self) -> bool {
        matches!(self.0, 5..=8)
    }

    /// Width and height as shown, from those stored.
    #[must_use]
    pub fn shown_size(self, width: u32, height: u32) -> (u32, u32) {
        if self.swaps_sides() {
            (height, width)
        } else {
            (width, height)
        }
    }

    fn steps(self, width: usize, height: usize) -> Steps {
        let (w, last_column, last_row) = (width.cast_signed(), width - 1, width * (height - 1));
        let (base, step_x, step_y) = match self.0 {
            2 => (last_column, -1, w),
            3 => (last_row + last_column, -1, -w),
            4 => (last_row, 1, -w),
            5 => (0, w, 1),
            6 => (last_row, -w, 1),
            7 => (last_row + last_column, -w, -1),
            8 => (last_column, w, -1),
            _ => (0, 1, w),
        };
        Steps {
            base,
            step_x,
            step_y,
        }
    }
}

/// Turns `width · height` stored pixels upright; the result has the shown size.
pub(super) fn turn<T: Copy + Default>(
    stored: Vec<T>,
    width: u32,
    height: u32,
    orientation: Orientation,
) -> Vec<T> {
    if stored.is_empty() || !matches!(orientation.0, 2..=8) {
        return stored;
    }
    let steps = orientation.steps(width as usize, height as usize);
    let (columns, rows) = orientation.shown_size(width, height);
    let (columns, rows) = (columns as usize, rows as usize);
    let mut shown = vec![T::default(); stored.len()];
    for top in (0..rows).step_by(BLOCK) {
        for left in (0..columns).step_by(BLOCK) {
            for y in top..rows.min(top + BLOCK) {
                let from = steps.base.cast_signed() + y.cast_signed() * steps.step_y;
                for x in left..columns.min(left + BLOCK) {
                    shown[y * columns + x] =
                        stored[(from + x.cast_signed() * steps.step_x).cast_unsigned()];
                }
            }
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use image::metadata::Orientation as Exif;

    use super::*;

    #[test]
    fn every_orientation_turns_as_exif_says() {
        let (width, height) = (67, 41);
        let stored: Vec<u16> = (0..width * height).collect();
        let buffer = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(
            width.into(),
            height.into(),
            stored.clone(),
        )
        .unwrap();
        for value in 1..=8 {
            let mut expected = image::DynamicImage::ImageLuma16(buffer.clone());
            expected.apply_orientation(Exif::from_exif(value).unwrap());
            let orientation = Orientation(value);
            let shown = turn(stored.clone(), width.into(), height.into(), orientation);
            assert_eq!(
                orientation.shown_size(width.into(), height.into()),
                (expected.width(), expected.height()),
                "orientation {value}"
            );
            assert_eq!(
                shown,
                expected.into_luma16().into_raw(),
                "orientation {value}"
            );
        }
    }

    #[test]
    fn an_empty_picture_stays_empty() {
        assert!(turn(Vec::<u8>::new(), 0, 0, Orientation(6)).is_empty());
    }
}
