use pulp::{Arch, Simd, WithSimd};

use super::plane::{Hypothesis, Plane, Raster, Transfer};
use super::posed_image::{Texture, Tones};
use super::random::Dice;
use super::window::{NOISE, Patch, SupportWindow, TAPS};

struct Cost<'a>(&'a Texture, &'a Texture, &'a Transfer, Hypothesis);

impl WithSimd for Cost<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let window = SupportWindow::default();
        let patch = Patch::new(&window, self.0, self.3.x as usize, self.3.y as usize);
        patch.cost(simd, &window, self.3, self.2, self.1)
    }
}

fn noise(seed: u32) -> Texture {
    let grey = |at: u32| 40.0 + 150.0 * Dice::new(seed, 0, at).unit();
    Texture::new(&Tones {
        width: 40,
        height: 30,
        luma: (0..1200).map(grey).collect(),
        chroma: Vec::new(),
    })
}

/// Computes the same in double precision, tap by tap.
fn plain(
    reference: &Texture,
    source: &Texture,
    transfer: &Transfer,
    hypothesis: Hypothesis,
) -> f64 {
    let Hypothesis { plane, x, y } = hypothesis;
    let window = SupportWindow::default();
    let weights = Patch::new(&window, reference, x as usize, y as usize)
        .weights
        .map(f64::from);
    let mut pairs = [(0.0, 0.0); TAPS];
    for (tap, pair) in pairs.iter_mut().enumerate() {
        let (dx, dy) = (window.dx[tap], window.dy[tap]);
        let [u, v, z] = transfer.apply(x + dx, y + dy, plane.moved(dx, dy).inverse_depth);
        let (u, v) = (
            f64::from(u / z).clamp(0.0, 39.0),
            f64::from(v / z).clamp(0.0, 29.0),
        );
        let grey =
            |x: f64, y: f64| f64::from(source.grey((x as usize).min(39), (y as usize).min(29)));
        let (s, t) = (u.fract(), v.fract());
        let above = (1.0 - s) * grey(u, v) + s * grey(u + 1.0, v);
        let below = (1.0 - s) * grey(u, v + 1.0) + s * grey(u + 1.0, v + 1.0);
        *pair = (
            f64::from(reference.grey((x + dx) as usize, (y + dy) as usize)),
            (1.0 - t) * above + t * below,
        );
    }
    let mean = |value: &dyn Fn(&(f64, f64)) -> f64| {
        pairs
            .iter()
            .zip(weights)
            .map(|(p, w)| w * value(p))
            .sum::<f64>()
    };
    let (a, b) = (mean(&|p| p.0), mean(&|p| p.1));
    let cross = mean(&|p| (p.0 - a) * (p.1 - b));
    let (va, vb) = (mean(&|p| (p.0 - a).powi(2)), mean(&|p| (p.1 - b).powi(2)));
    1.0 - cross / ((va + f64::from(NOISE)) * (vb + f64::from(NOISE))).sqrt()
}

#[test]
fn ncc_equals_that_of_a_plain_loop() {
    let (reference, source) = (noise(1), noise(2));
    let transfer = Transfer {
        matrix: [[0.95, 0.04, 1e-4], [-0.03, 1.02, -2e-4], [1.3, -0.6, 1.0]],
        offset: [8.0, 0.5, 0.02],
    };
    for step in 0..200 {
        let mut dice = Dice::new(9, 1, step);
        let slope = [0.02 * dice.signed(), 0.02 * dice.signed()];
        let plane = Plane {
            inverse_depth: 0.1 + 0.2 * dice.unit(),
            slope,
        };
        let at = Hypothesis {
            plane,
            x: (6.0 + 24.0 * dice.unit()).floor(),
            y: (6.0 + 16.0 * dice.unit()).floor(),
        };
        let (found, expected) = (
            Arch::new().dispatch(Cost(&reference, &source, &transfer, at)),
            plain(&reference, &source, &transfer, at),
        );
        assert!(
            (f64::from(found) - expected).abs() < 2e-3,
            "{found} {expected}"
        );
        let scalar = pulp::Scalar::new().vectorize(Apart(Cost(&reference, &source, &transfer, at)));
        assert!((found - scalar).abs() < 2e-3, "{found} {scalar}");
    }
}

/// The same without vectors.
struct Apart<'a>(Cost<'a>);

impl pulp::NullaryFnOnce for Apart<'_> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        self.0.with_simd(pulp::Scalar::new())
    }
}

/// Returns a plane as the hypothesis of a pixel near the middle.
fn in_middle(plane: Plane) -> Hypothesis {
    Hypothesis {
        plane,
        x: 20.0,
        y: 15.0,
    }
}

#[test]
fn image_has_no_cost_against_itself() {
    let texture = noise(3);
    let same = Transfer {
        matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        offset: [1.0, 0.0, 0.0],
    };
    let plane = Plane::default();
    assert!(Arch::new().dispatch(Cost(&texture, &texture, &same, in_middle(plane))) < 0.01);
    let adjacent = Plane {
        inverse_depth: 5.0,
        ..plane
    };
    assert!(Arch::new().dispatch(Cost(&texture, &texture, &same, in_middle(adjacent))) > 0.3);
}

#[test]
fn without_texture_chroma_counts_and_light_does_not() {
    let flat = |luma: f32, chroma: [f32; 2]| {
        Texture::new(&Tones {
            width: 40,
            height: 30,
            luma: vec![luma; 1200],
            chroma: vec![chroma; 1200],
        })
    };
    let same = Transfer {
        matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        offset: [1.0, 0.0, 0.0],
    };
    let leaf = flat(120.0, [-20.0, -20.0]);
    let seen_in = |source: &Texture| {
        Arch::new().dispatch(Cost(&leaf, source, &same, in_middle(Plane::default())))
    };
    let same_leaf = seen_in(&leaf);
    assert_eq!(
        seen_in(&flat(60.0, [-20.0, -20.0])),
        same_leaf,
        "in the shade"
    );
    assert_eq!(seen_in(&flat(120.0, [-17.0, -16.0])), same_leaf, "noise");
    assert!(
        seen_in(&flat(120.0, [0.0, 20.0])) > same_leaf + 0.5,
        "a wall of the same brightness"
    );
}

#[test]
fn plane_is_recovered_from_its_normal() {
    let raster = Raster {
        focal: [300.0, 310.0],
        principal: [80.0, 60.0],
    };
    let plane = Plane {
        inverse_depth: 0.4,
        slope: [3e-4, -5e-4],
    };
    let normal = plane.normal(&raster, 33.0, 90.0);
    let back = Plane::from_normal(2.5, normal, &raster, 33.0, 90.0);
    assert!((back.inverse_depth - 0.4).abs() < 1e-6);
    assert!(
        back.slope
            .iter()
            .zip(plane.slope)
            .all(|(a, b)| (a - b).abs() < 1e-7),
        "{back:?}"
    );
    assert!(normal.dot(raster.ray(33.0, 90.0)) < 0.0);
}
