use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::fpfh::{Descriptor, SIZE};
use ostra_core::job::{Progress, Stopped};

/// Descriptors compared in parallel.
const LANES: usize = 16;
/// Descriptors processed between two checks for a stop.
const CHUNK: usize = 64;

/// Transposed descriptors: a row of `LANES` for each of their values.
type DescriptorLanes = [[f32; LANES]; SIZE];

/// Two descriptors that are each other's nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DescriptorMatch {
    /// Index in the source's list.
    pub source: u32,
    /// Index in the target's list.
    pub target: u32,
    /// Squared distance of the descriptors.
    pub distance: f32,
}

/// Returns pairs of descriptors that are each other's nearest, most similar first.
///
/// All are compared with all: a k-d tree in 33 dimensions visits so many of them that it takes
/// longer (16 000 descriptors).
///
/// # Errors
/// [`Stopped`].
pub fn mutual(
    source: &[Descriptor],
    target: &[Descriptor],
    progress: &Progress,
) -> Result<Vec<DescriptorMatch>, Stopped> {
    let there = nearest(source, &blocks(target), progress)?;
    let mut met: Vec<u32> = there.iter().map(|&(target, _)| target).collect();
    met.sort_unstable();
    met.dedup();
    let queries: Vec<Descriptor> = met
        .iter()
        .filter_map(|&index| target.get(index as usize).copied())
        .collect();
    let back = nearest(&queries, &blocks(source), progress)?;
    let mut matches: Vec<DescriptorMatch> = met
        .iter()
        .zip(back)
        .filter(|&(&target, (source, _))| {
            there
                .get(source as usize)
                .is_some_and(|found| found.0 == target)
        })
        .map(|(&target, (source, distance))| DescriptorMatch {
            source,
            target,
            distance,
        })
        .collect();
    matches.sort_by(|a, b| {
        a.distance
            .total_cmp(&b.distance)
            .then(a.source.cmp(&b.source))
    });
    Ok(matches)
}

fn blocks(descriptors: &[Descriptor]) -> Vec<DescriptorLanes> {
    let block = |chunk: &[Descriptor]| {
        // Positions without a descriptor are infinitely far.
        let mut block = [[f32::INFINITY; LANES]; SIZE];
        for (lane, descriptor) in chunk.iter().enumerate() {
            for (row, value) in block.iter_mut().zip(descriptor) {
                row[lane] = *value;
            }
        }
        block
    };
    descriptors.chunks(LANES).map(block).collect()
}

/// Returns the nearest of those in blocks to each of `asked`, as (index, squared distance); the earlier of equals.
fn nearest(
    queries: &[Descriptor],
    blocks: &[DescriptorLanes],
    progress: &Progress,
) -> Result<Vec<(u32, f32)>, Stopped> {
    let arch = Arch::new();
    let of_chunk = |chunk: &[Descriptor]| {
        progress.check()?;
        Ok(chunk
            .iter()
            .map(|queries| arch.dispatch(Nearest { queries, blocks }))
            .collect())
    };
    let chunks: Vec<Vec<(u32, f32)>> = queries
        .par_chunks(CHUNK)
        .map(of_chunk)
        .collect::<Result<_, _>>()?;
    Ok(chunks.concat())
}

struct Nearest<'a> {
    queries: &'a Descriptor,
    blocks: &'a [DescriptorLanes],
}

impl WithSimd for Nearest<'_> {
    type Output = (u32, f32);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> (u32, f32) {
        let mut least = [f32::INFINITY; LANES];
        let mut place = [u32::MAX; LANES];
        for (at, block) in self.blocks.iter().enumerate() {
            let mut sums = [0.0; LANES];
            for (row, value) in block.iter().zip(self.queries) {
                for lane in 0..LANES {
                    let difference = row[lane] - value;
                    sums[lane] += difference * difference;
                }
            }
            for lane in 0..LANES {
                let nearer = sums[lane] < least[lane];
                least[lane] = if nearer { sums[lane] } else { least[lane] };
                place[lane] = if nearer {
                    (at * LANES + lane) as u32
                } else {
                    place[lane]
                };
            }
        }
        (0..LANES).map(|lane| (place[lane], least[lane])).fold(
            (u32::MAX, f32::INFINITY),
            |best, one| {
                if (one.1, one.0) < (best.1, best.0) {
                    one
                } else {
                    best
                }
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn mutual_pairs_equal_those_of_a_plain_search() {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(2);
        let mut list = |count: usize| -> Vec<Descriptor> {
            (0..count)
                .map(|_| std::array::from_fn(|_| random.random_range(0.0..9.0)))
                .collect()
        };
        let (source, target) = (list(150), list(77));
        let distance = |a: &Descriptor, b: &Descriptor| -> f32 {
            a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
        };
        let closest = |to: &Descriptor, among: &[Descriptor]| {
            (0..among.len())
                .min_by(|&a, &b| distance(to, &among[a]).total_cmp(&distance(to, &among[b])))
                .unwrap()
        };
        let mut plain: Vec<(u32, u32)> = Vec::new();
        for (index, one) in source.iter().enumerate() {
            let other = closest(one, &target);
            if closest(&target[other], &source) == index {
                plain.push((index as u32, other as u32));
            }
        }
        let found = mutual(&source, &target, &Progress::default()).unwrap();
        assert!(found.is_sorted_by(|a, b| a.distance <= b.distance) && plain.len() > 20);
        let mut pairs: Vec<(u32, u32)> = found.iter().map(|one| (one.source, one.target)).collect();
        pairs.sort_unstable();
        assert_eq!(pairs, plain);
        assert!(
            mutual(&source, &[], &Progress::default())
                .unwrap()
                .is_empty()
        );
        assert!(
            mutual(&[], &target, &Progress::default())
                .unwrap()
                .is_empty()
        );
    }
}
