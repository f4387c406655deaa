use glam::Vec3;
use rand::{RngExt, SeedableRng};

use super::super::point_spacing::median_spacing;
use super::*;

#[test]
fn blocks_hold_each_point_once_and_block_prefixes_are_spread_evenly() {
    let positions: Vec<Vec3> = (0..250_000)
        .map(|i| Vec3::new((i % 500) as f32, (i / 500) as f32, 0.0))
        .collect();
    let all = PointLod::of(&positions);
    assert!(all.blocks.len() > 4 && all.len() == positions.len());
    let mut seen = vec![0; positions.len()];
    for (number, block) in all.blocks.iter().enumerate() {
        let Bounds { min, max } = block.bounds;
        for Disc { index, .. } in all.part_of(number, 0..block.len()) {
            seen[index] += 1;
            assert!(positions[index].cmpge(min).all() && positions[index].cmple(max).all());
        }
        // About 25 of 100 points lie in each quartile of a coordinate.
        for along_axis in [Vec3::X, Vec3::Y] {
            let along = |part| {
                all.part_of(number, part)
                    .map(|disc| positions[disc.index].dot(along_axis))
            };
            let mut sorted: Vec<f32> = along(0..block.len()).collect();
            sorted.sort_by(f32::total_cmp);
            let quarters = [1, 2, 3].map(|quarter| sorted[block.len() * quarter / 4]);
            let mut counts = [0; 4];
            along(0..100).for_each(|x| {
                counts[quarters.iter().filter(|&&limit| x >= limit).count()] += 1;
            });
            assert!(
                counts.iter().all(|count| (15..=35).contains(count)),
                "block {number}: {counts:?}"
            );
        }
    }
    assert!(seen.iter().all(|&times| times == 1));
}

#[test]
fn sample_is_spread_over_the_cloud_with_discs_that_close_the_surface() {
    let positions: Vec<Vec3> = (0..90_000)
        .map(|i| Vec3::new((i % 300) as f32, (i / 300) as f32, 0.0))
        .collect();
    let sample = PointLod::of_sample(&positions, 10_000);
    let left = sample
        .discs()
        .filter(|disc| positions[disc.index].x < 150.0)
        .count();
    assert!(
        sample.len() == 10_000 && (4500..5500).contains(&left),
        "{left}"
    );
    let radius = sample.discs().map(|disc| disc.radius).sum::<f32>() / 10_000.0;
    assert!(
        (2.0..3.3).contains(&radius),
        "{radius} for every third point along each axis"
    );
}

#[test]
fn every_point_is_in_one_compact_block_despite_outliers() {
    let mut positions: Vec<Vec3> = (0..40_000)
        .map(|i| Vec3::new((i % 200) as f32, 0.0, (i / 200) as f32) * 0.01)
        .collect();
    positions.extend([Vec3::splat(1e9), Vec3::NEG_X * 1e4, Vec3::NAN]);
    let along = ZOrder::new(&positions, positions.len(), |place| place, 1000);
    let mut seen = along.order.clone();
    seen.sort_unstable();
    assert!(
        seen.into_iter().eq(0..positions.len() as u32),
        "a permutation"
    );
    assert!(
        along
            .blocks
            .iter()
            .flat_map(Clone::clone)
            .eq(0..positions.len()),
        "blocks follow each other"
    );
    let wide = |block: &Range<usize>| {
        let x = || {
            along.order[block.clone()]
                .iter()
                .map(|&index| positions[index as usize].x)
        };
        x().fold(0.0, f32::max) - x().fold(f32::MAX, f32::min)
    };
    let compact = along
        .blocks
        .iter()
        .filter(|block| wide(block) < 0.7)
        .count();
    assert!(
        compact * 10 >= along.blocks.len() * 9,
        "{compact} of {}",
        along.blocks.len()
    );
    let sizes = along.blocks[..along.blocks.len() - 1]
        .iter()
        .map(ExactSizeIterator::len);
    assert!(
        sizes.clone().all(|size| (500..=1500).contains(&size)),
        "{:?}",
        sizes.collect::<Vec<_>>()
    );
}

/// Returns the spacing by point index.
fn spacing(positions: &[Vec3]) -> Vec<f32> {
    let order = ZOrder::new(positions, positions.len(), |place| place, 1000).order;
    let along = local_spacing(positions, &order);
    let mut by_index = vec![0.0; positions.len()];
    order
        .iter()
        .zip(along)
        .for_each(|(&index, spacing)| by_index[index as usize] = spacing.length);
    by_index
}

/// Returns `side` × `side` random points on a square.
fn strewn(side: usize, width: f32) -> Vec<Vec3> {
    let mut random = rand_pcg::Pcg64::seed_from_u64(7);
    (0..side * side)
        .map(|_| Vec3::new(random.random::<f32>(), random.random::<f32>(), 0.0) * width)
        .collect()
}

#[test]
fn spacing_on_a_plane_matches_the_step_for_grid_and_random_points() {
    let grid: Vec<Vec3> = (0..40_000)
        .map(|i| Vec3::new((i % 200) as f32, (i / 200) as f32, 0.0) * 0.01)
        .collect();
    for (what, positions) in [("grid", grid), ("strewn", strewn(200, 2.0))] {
        let spacing = spacing(&positions);
        let usual = median_spacing(spacing.clone());
        assert!((0.0095..0.0145).contains(&usual), "{what}: {usual}");
        let near = spacing
            .iter()
            .filter(|one| (0.006..0.02).contains(*one))
            .count();
        assert!(near * 100 >= spacing.len() * 90, "{what}: {near}");
    }
}

#[test]
fn spacing_is_local_and_outliers_do_not_increase_it() {
    let mut positions = strewn(150, 1.0);
    let dense = positions.len();
    positions.extend(strewn(40, 1.0).into_iter().map(|x| x - Vec3::X));
    let sparse = positions.len();
    positions.extend([Vec3::splat(30.0), Vec3::new(-20.0, 9.0, 1.0), Vec3::NAN]);
    let spacing = spacing(&positions);
    let share = |range: std::ops::Range<usize>, step: f32| {
        let near = spacing[range.clone()]
            .iter()
            .filter(|one| (0.5 * step..2.0 * step).contains(*one))
            .count();
        near * 100 / range.len()
    };
    assert!(
        share(0..dense, 1.0 / 150.0) >= 90,
        "{}",
        share(0..dense, 1.0 / 150.0)
    );
    assert!(
        share(dense..sparse, 1.0 / 40.0) >= 85,
        "{}",
        share(dense..sparse, 1.0 / 40.0)
    );
    assert!(
        spacing[sparse..].iter().all(|&one| one < 0.06),
        "{:?}",
        &spacing[sparse..]
    );
}

#[test]
fn lone_points_are_small_and_do_not_shade_others() {
    let mut positions = strewn(100, 1.0);
    let surface = positions.len();
    positions.extend((1..=30).map(|k| Vec3::new(0.5, 0.5, k as f32)));
    let all = PointLod::of(&positions);
    let usual = median_spacing(spacing(&positions));
    let mut lone = 0;
    for disc in all.discs().collect::<Vec<_>>() {
        if disc.index < surface {
            // Not even where the curve jumps and the neighbours are far away along it.
            assert!(!disc.is_lone, "{disc:?}");
            assert_eq!(disc.shade([1, 2, 3, 255]), [1, 2, 3, 255]);
        } else {
            assert!(
                disc.is_lone && disc.radius <= 1.1 * usual,
                "{disc:?} {usual}"
            );
            assert_eq!(disc.shade([1, 2, 3, 255]), [1, 2, 3, 254]);
            assert_eq!(disc.shade([0; 4]), [0; 4], "it stays hidden");
            lone += 1;
        }
    }
    assert_eq!(lone, 30);
}

#[test]
fn spacing_is_zero_for_too_few_points_and_ignores_duplicates() {
    assert_eq!(spacing(&[Vec3::ONE, Vec3::X]), [0.0; 2]);
    let square = strewn(60, 1.0);
    let twice: Vec<Vec3> = square.iter().flat_map(|&x| [x; 3]).collect();
    assert!(median_spacing(spacing(&twice)) > 1.0 / 60.0 * 0.6);
}

fn all_that_comes(lod_build: &LodBuild) -> Vec<Arc<PointLod>> {
    let mut came = Vec::new();
    loop {
        match lod_build.next() {
            Arrival::Some(point_lod) => came.push(point_lod),
            Arrival::NotYet => std::thread::yield_now(),
            Arrival::Over => return came,
        }
    }
}

fn row(points: usize) -> Arc<LabelledCloud> {
    Arc::new(LabelledCloud::from_positions(
        (0..points).map(|i| Vec3::X * i as f32).collect(),
    ))
}

#[test]
fn sample_is_sent_first_and_equal_positions_reuse_the_arrangement() {
    let large = row(SAMPLE + 1000);
    let came = all_that_comes(&LodBuild::begin(Arc::clone(&large), None));
    assert_eq!(
        came.iter().map(|one| one.len()).collect::<Vec<_>>(),
        [SAMPLE, SAMPLE + 1000]
    );
    let recolored = Arc::new(LabelledCloud {
        colors: vec![[1, 2, 3]; large.len()],
        ..(*large).clone()
    });
    let again = all_that_comes(&LodBuild::begin(
        recolored,
        Some((large, Arc::clone(&came[1]))),
    ));
    assert!(again.len() == 1 && Arc::ptr_eq(&again[0], &came[1]));
    let small = all_that_comes(&LodBuild::begin(
        row(100),
        Some((row(101), Arc::clone(&came[1]))),
    ));
    assert_eq!(small.iter().map(|one| one.len()).collect::<Vec<_>>(), [100]);
}

#[test]
fn dropping_the_work_releases_the_cloud() {
    let cloud = row(200_000);
    drop(LodBuild::begin(Arc::clone(&cloud), None));
    let ended = (0..50_000_000).any(|_| {
        std::thread::yield_now();
        Arc::strong_count(&cloud) == 1
    });
    assert!(ended, "the cloud has no other owner in the end");
}
