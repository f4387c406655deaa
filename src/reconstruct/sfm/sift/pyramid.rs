use super::blur::halve;
use super::kernel::{DOUBLING_VARIANCE, Kernel};
use super::options::SiftOptions;
use super::rows::Rows;

/// Blur of the first level of every octave, in samples of the octave (Lowe 2004, section 3.3). It is given in full: the
/// blur that a picture has already, which Lowe takes to be 0.5 pixels, is not counted, since its noise has none. That
/// finds a tenth more true matches in real pictures.
pub(super) const FIRST_SIGMA: f32 = 1.6;

/// Blur of level `level` in samples of its octave.
pub(super) fn level_sigma(level: f32, scales: usize) -> f32 {
    FIRST_SIGMA * (level / scales as f32).exp2()
}

/// The blur that takes level `level - 1` to level `level`.
pub(super) fn step_kernel(level: usize, scales: usize) -> Kernel {
    let [before, after] = [level - 1, level].map(|level| level_sigma(level as f32, scales));
    Kernel::gaussian((after * after - before * before).sqrt())
}

/// The kernels that make the first level of octave -1 out of the picture.
pub(super) fn doubling_kernels() -> [Kernel; 2] {
    Kernel::doubling((FIRST_SIGMA * FIRST_SIGMA - DOUBLING_VARIANCE).sqrt())
}

/// The blur that makes the first level of octave 0 out of the picture.
pub(super) fn picture_kernel() -> Kernel {
    Kernel::gaussian(FIRST_SIGMA)
}

/// First levels of the octaves 0, 1, … that the options ask for, as far as the picture is large enough.
pub(super) fn bases(picture: &Rows, options: &SiftOptions) -> Vec<Rows> {
    let last = options.first_octave.max(-1) + options.octaves.max(1) as i32 - 1;
    let mut bases = Vec::new();
    if last < 0 {
        return bases;
    }
    let mut base = Rows::new(picture.width, picture.height, picture.height);
    super::blur::blur(picture, &picture_kernel(), &mut base, 0, picture.height);
    let kernel = Kernel::gaussian(FIRST_SIGMA * 3_f32.sqrt());
    for _ in 0..last {
        if base.width.min(base.height) < 2 * SMALLEST_SIDE {
            break;
        }
        let next = halve(&base, &kernel);
        bases.push(std::mem::replace(&mut base, next));
    }
    bases.push(base);
    bases
}

/// Shortest side of an octave in samples: below, no descriptor fits.
const SMALLEST_SIDE: usize = 12;
