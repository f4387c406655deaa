/// Length of SIFT's descriptors in bytes.
const BYTE_LENGTH: f32 = 512.0;
/// Partial sums of a dot product of floats, in an order that every processor keeps.
const PARTS: usize = 16;

/// One value of a descriptor.
pub(crate) trait Value: Copy + Send + Sync {
    /// As a value of a vector of length 1.
    fn unit(self) -> f32;

    /// Dot product of two descriptors as vectors of length 1.
    fn dot(a: &[Self], b: &[Self]) -> f32;
}

impl Value for u8 {
    #[inline(always)]
    fn unit(self) -> f32 {
        f32::from(self) / BYTE_LENGTH
    }

    #[inline(always)]
    fn dot(a: &[Self], b: &[Self]) -> f32 {
        let sum: i32 = a
            .iter()
            .zip(b)
            .map(|(&a, &b)| i32::from(a) * i32::from(b))
            .sum();
        sum as f32 / (BYTE_LENGTH * BYTE_LENGTH)
    }
}

impl Value for f32 {
    #[inline(always)]
    fn unit(self) -> f32 {
        self
    }

    #[inline(always)]
    fn dot(a: &[Self], b: &[Self]) -> f32 {
        let mut sums = [0.0; PARTS];
        let (a, a_rest) = a.as_chunks::<PARTS>();
        let (b, b_rest) = b.as_chunks::<PARTS>();
        for (a, b) in a.iter().zip(b) {
            for lane in 0..PARTS {
                sums[lane] += a[lane] * b[lane];
            }
        }
        sums.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
    }
}
