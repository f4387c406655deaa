use ostra_masks::Region;

/// The colour of what is contradicted, sRGB.
const COLOR: [u8; 3] = [235, 60, 50];
/// Stripes across the longer side of a picture, and the least width of one with its gap, pixels.
const STRIPES: u32 = 120;
const LEAST_PX: u32 = 8;

/// A region as stripes with a border, `width · height` straight-alpha sRGB pixels, to be laid over a picture and its masks.
#[must_use]
pub fn hatch(region: &Region) -> Vec<[u8; 4]> {
    let period = (region.width.max(region.height) / STRIPES).max(LEAST_PX) as usize;
    let (width, height) = (region.width as usize, region.height as usize);
    let is_inside = |x: usize, y: usize| x < width && y < height && region.inside[y * width + x];
    let color = |(at, &inside): (usize, &bool)| {
        if !inside {
            return [0; 4];
        }
        let (x, y) = (at % width, at / width);
        let around = [
            (x.wrapping_sub(1), y),
            (x + 1, y),
            (x, y.wrapping_sub(1)),
            (x, y + 1),
        ];
        let is_border = around.into_iter().any(|(x, y)| !is_inside(x, y));
        let [r, g, b] = COLOR;
        if is_border || (x + y) % period < period / 2 {
            [r, g, b, 255]
        } else {
            [0; 4]
        }
    };
    region.inside.iter().enumerate().map(color).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_region_is_striped_and_its_border_is_whole() {
        let mut region = Region::empty(40, 30);
        for y in 0..20 {
            (5..25).for_each(|x| region.inside[y * 40 + x] = true);
        }
        let pixels = hatch(&region);
        let opaque = |x: usize, y: usize| pixels[y * 40 + x][3] == 255;
        assert!(
            (0..20).all(|y| opaque(5, y) && opaque(24, y))
                && (5..25).all(|x| opaque(x, 0) && opaque(x, 19))
        );
        let stripes = (6..24).filter(|&x| opaque(x, 10)).count();
        assert!(
            (6..=12).contains(&stripes),
            "half of it shows the picture: {stripes}"
        );
        assert!((0..1200).all(|at| region.inside[at] || pixels[at] == [0; 4]));
    }
}
