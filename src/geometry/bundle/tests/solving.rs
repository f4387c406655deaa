use nalgebra::{DMatrix, DVector};

use super::scene::{Noise, blur, disturb, dome, pinhole};
use crate::Distortion;
use crate::blocks::{BLOCK, Column6, Skyline, conjugate_gradients};
use crate::bundle::adjust::CandidateStep;
use crate::bundle::arrange::arrange;
use crate::bundle::layout::{Layout, PointBlock};
use crate::bundle::normal::Normal;
use crate::bundle::state::CameraState;
use crate::bundle::{Bundle, BundleOptions, Loss, Refine};

const DAMPING: f64 = 1e-3;

fn disturbed(bundle: Bundle) -> Bundle {
    let mut bundle = bundle;
    blur(&mut bundle, 0.5, 2);
    disturb(&mut bundle, 0.005, 0.01, 3);
    bundle
}

/// Returns the step of the full normal equations and the model's decrease.
///
/// The equations include the points and have no padding.
fn without_elimination(
    layout: &Layout,
    point_blocks: &[PointBlock],
    state: &CameraState,
) -> (DVector<f64>, f64) {
    let before = layout.len() * BLOCK;
    let points: usize = point_blocks
        .iter()
        .map(|point_block| point_block.points.len())
        .sum();
    let (mut matrix, mut right) = (
        DMatrix::zeros(before + 3 * points, before + 3 * points),
        DVector::zeros(0),
    );
    right.resize_vertically_mut(before + 3 * points, 0.0);
    let mut first = before;
    for point_block in point_blocks {
        for (p, &point) in point_block.points.iter().enumerate() {
            for observation in &point_block.observations[point_block.observations_of(p)] {
                let observed = state.observe(point, observation).unwrap();
                let mut rows: Vec<(usize, [f64; 2])> = Vec::new();
                let mut push = |at: usize, [x, y]: [Column6; 2]| {
                    rows.extend((0..BLOCK).map(|i| (at * BLOCK + i, [x[i], y[i]])));
                };
                if let Some(block) = layout.poses[observation.image as usize] {
                    push(block, observed.by_pose());
                }
                let intrinsics = layout.intrinsics[state.camera_of(observation.image)].clone();
                intrinsics
                    .zip(observed.by_intrinsics())
                    .for_each(|(block, by)| push(block, by));
                rows.extend((0..3).map(|i| (first + i, observed.by_point.map(|d| d[i]))));
                for &(i, a) in &rows {
                    right[i] -= a[0] * observed.residual.x + a[1] * observed.residual.y;
                    for &(j, b) in &rows {
                        matrix[(i, j)] += a[0] * b[0] + a[1] * b[1];
                    }
                }
            }
            first += 3;
        }
    }
    let undamped = matrix.clone();
    for i in 0..matrix.nrows() {
        let own = matrix[(i, i)];
        matrix[(i, i)] = if own > 0.0 {
            own * (1.0 + DAMPING)
        } else {
            1.0
        };
    }
    let step = matrix.cholesky().unwrap().solve(&right);
    let fall = right.dot(&step) - 0.5 * step.dot(&(undamped * &step));
    (step, fall)
}

#[test]
fn step_equals_that_of_the_full_normal_equations() {
    let bent = crate::Camera {
        distortion: Distortion::Radial { k: [-0.1, 0.02] },
        ..pinhole()
    };
    let bundle = disturbed(dome(vec![bent, pinhole()], 8, 300, 0.6, 1));
    let options = BundleOptions {
        loss: Loss::Cauchy { px: 5.0 },
        refine: vec![Refine {
            focal: true,
            principal: true,
            distortion: true,
        }],
        fixed_images: vec![false, true],
        ..BundleOptions::default()
    };
    let state = CameraState::new(&bundle, &options);
    let (layout, mut point_blocks) = arrange(&bundle, &options, &state);
    assert!(point_blocks.len() > 2 && layout.len() == 8);
    let (expected, fall) = without_elimination(&layout, &point_blocks, &state);
    let mut normal = Normal::new(&layout);
    normal.build(&point_blocks, &layout, &state, DAMPING);
    let step = normal.solve().unwrap();
    let moved = state.moved(&layout, &step);
    let candidate = CandidateStep {
        layout: &layout,
        state: &state,
        moved: &moved,
        step: &step,
        damping: DAMPING,
    };
    let outcome = candidate.evaluate(&mut point_blocks);
    let shifts = point_blocks.iter().flat_map(|point_block| {
        point_block
            .tried
            .iter()
            .zip(&point_block.points)
            .map(|(a, b)| *a - *b)
    });
    let found = step
        .as_flattened()
        .iter()
        .copied()
        .chain(shifts.flat_map(|shift| shift.to_array()));
    let found = DVector::from_iterator(expected.len(), found);
    assert!((&found - &expected).norm() < 1e-8 * expected.norm());
    assert!(
        (outcome.predicted / fall - 1.0).abs() < 1e-8,
        "{} {fall}",
        outcome.predicted
    );
}

#[test]
fn skyline_solves_like_a_dense_matrix() {
    let first = [0, 0, 1, 3, 2, 0, 5, 3];
    let size = first.len() * BLOCK;
    let mut noise = Noise::new(5);
    let mut dense = DMatrix::<f64>::identity(size, size) * 20.0;
    let mut skyline = Skyline::new(&first);
    for i in 0..size {
        for j in (first[i / BLOCK] * BLOCK..=i).rev() {
            dense[(i, j)] += noise.normal();
            dense[(j, i)] = dense[(i, j)];
        }
    }
    for (i, row) in skyline.rows.iter_mut().enumerate() {
        for (j, block) in row.blocks.iter_mut().enumerate() {
            let at = |r: usize, c: usize| (i * BLOCK + r, (row.first + j) * BLOCK + c);
            *block = std::array::from_fn(|c| std::array::from_fn(|r| dense[at(r, c)]));
        }
    }
    let right: Vec<Column6> = first
        .iter()
        .map(|_| std::array::from_fn(|_| noise.normal()))
        .collect();
    let expected = dense
        .cholesky()
        .unwrap()
        .solve(&DVector::from_column_slice(right.as_flattened()));
    assert!(skyline.factor());
    let mut found = right.clone();
    skyline.solve(&mut found);
    assert!((DVector::from_column_slice(found.as_flattened()) - expected).norm() < 1e-10);
    skyline.rows[3].blocks[0][2][2] = -1.0;
    assert!(!skyline.factor());
}

#[test]
fn conjugate_gradients_gain_as_much_as_factorisation() {
    let bundle = disturbed(dome(vec![pinhole()], 60, 800, 0.2, 4));
    let options = BundleOptions {
        refine: vec![Refine {
            focal: true,
            principal: true,
            distortion: false,
        }],
        ..BundleOptions::default()
    };
    let state = CameraState::new(&bundle, &options);
    let (layout, mut point_blocks) = arrange(&bundle, &options, &state);
    let mut normal = Normal::new(&layout);
    normal.build(&point_blocks, &layout, &state, 1e-4);
    let near = conjugate_gradients(&normal.matrix, &normal.right).unwrap();
    let exact = normal.solve().unwrap();
    let mut fall = |step: &[Column6]| {
        let moved = state.moved(&layout, step);
        let candidate = CandidateStep {
            layout: &layout,
            state: &state,
            moved: &moved,
            step,
            damping: 1e-4,
        };
        candidate.evaluate(&mut point_blocks).predicted
    };
    let (near, exact) = (fall(&near), fall(&exact));
    assert!(
        near > 0.95 * exact && near < 1.0001 * exact,
        "{near} {exact}"
    );
}
