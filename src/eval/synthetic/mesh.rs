use glam::{DQuat, DVec3, Vec2, Vec3};

/// A triangle mesh with a texture position per vertex; lengths are in metres.
#[derive(Debug, Clone, Default)]
pub(super) struct Mesh {
    pub(super) positions: Vec<DVec3>,
    /// Unit length; outwards on closed surfaces.
    pub(super) normals: Vec<Vec3>,
    /// Texture position in metres: x across or around, y along.
    pub(super) uv: Vec<Vec2>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Creates a patch of `rows` × `columns` cells.
    ///
    /// `vertex(r, c)` returns the corners for `r ≤ rows` and `c ≤ columns`. With `around`, the last
    /// column coincides with the first. Normals point along (column direction) × (row direction).
    pub(super) fn patch(
        rows: usize,
        columns: usize,
        around: bool,
        vertex: impl Fn(usize, usize) -> (DVec3, Vec2),
    ) -> Self {
        let index = |r: usize, c: usize| (r * (columns + 1) + c) as u32;
        let (positions, uv): (Vec<_>, Vec<_>) = (0..=rows)
            .flat_map(|r| (0..=columns).map(move |c| (r, c)))
            .map(|(r, c)| vertex(r, c))
            .unzip();
        let triangles: Vec<[u32; 3]> = (0..rows)
            .flat_map(|r| (0..columns).map(move |c| (r, c)))
            .flat_map(|(r, c)| {
                let (a, b, d, e) = (
                    index(r, c),
                    index(r, c + 1),
                    index(r + 1, c),
                    index(r + 1, c + 1),
                );
                [[a, b, e], [a, e, d]]
            })
            .collect();
        let mut sums = face_sums(&positions, &triangles);
        if around {
            for r in 0..=rows {
                let both = sums[index(r, 0) as usize] + sums[index(r, columns) as usize];
                sums[index(r, 0) as usize] = both;
                sums[index(r, columns) as usize] = both;
            }
        }
        let normals = sums
            .into_iter()
            .map(|n| n.normalize_or(DVec3::Z).as_vec3())
            .collect();
        Self {
            positions,
            normals,
            uv,
            triangles,
        }
    }

    /// Creates a tube with `columns` sides around `curve`, without caps.
    ///
    /// `radius` maps an arc length to a radius, both in metres.
    pub(super) fn tube(
        curve: &Curve,
        rows: usize,
        columns: usize,
        radius: impl Fn(f64) -> f64,
    ) -> Self {
        Self::patch(rows, columns, true, |r, c| {
            let station = curve.at(curve.length_m() * r as f64 / rows as f64);
            let angle = std::f64::consts::TAU * c as f64 / columns as f64;
            let radius = radius(station.at_m);
            let x = station.x + radius * (angle.cos() * station.side + angle.sin() * station.up);
            (
                x,
                DVec3::new(angle * radius, station.at_m, 0.0)
                    .truncate()
                    .as_vec2(),
            )
        })
    }

    /// Creates a surface of revolution about the vertical through `centre`.
    ///
    /// `profile` lists (radius, height) in metres, upwards on the outside.
    pub(super) fn lathe(centre: DVec3, profile: &[(f64, f64)], columns: usize) -> Self {
        let mut along = vec![0.0];
        for pair in profile.windows(2) {
            let step = (pair[1].0 - pair[0].0).hypot(pair[1].1 - pair[0].1);
            along.push(along.last().copied().unwrap_or(0.0) + step);
        }
        Self::patch(profile.len() - 1, columns, true, |r, c| {
            let angle = std::f64::consts::TAU * c as f64 / columns as f64;
            let (radius, height) = profile[r];
            let x = centre + DVec3::new(radius * angle.cos(), radius * angle.sin(), height);
            (
                x,
                Vec2::new((angle * radius.max(0.01)) as f32, along[r] as f32),
            )
        })
    }

    /// Creates a spheroid with a unit `axis` and the given half axes.
    pub(super) fn spheroid(
        centre: DVec3,
        axis: DVec3,
        half_length_m: f64,
        half_width_m: f64,
    ) -> Self {
        let (rows, columns) = (14, 12);
        let (side, up) = axis.any_orthonormal_pair();
        Self::patch(rows, columns, true, |r, c| {
            let latitude = std::f64::consts::PI * (r as f64 / rows as f64 - 0.5);
            let angle = std::f64::consts::TAU * c as f64 / columns as f64;
            let ring = half_width_m * latitude.cos() * (angle.cos() * side + angle.sin() * up);
            let uv = Vec2::new(
                (angle * half_width_m) as f32,
                (latitude * half_length_m) as f32,
            );
            (centre + half_length_m * latitude.sin() * axis + ring, uv)
        })
    }

    /// Creates a closed cylinder with `columns` sides and a unit `axis`.
    ///
    /// It extends by `half_length_m` to both sides of `centre`.
    pub(super) fn cylinder(
        centre: DVec3,
        axis: DVec3,
        radius_m: f64,
        half_length_m: f64,
        columns: usize,
    ) -> Self {
        let (r, h) = (radius_m, half_length_m);
        // Edges are doubled, so that the caps are shaded flat and the side round.
        let mut mesh = Self::lathe(
            DVec3::ZERO,
            &[(0.0, -h), (r, -h), (r, -h), (r, h), (r, h), (0.0, h)],
            columns,
        );
        let turn = DQuat::from_rotation_arc(DVec3::Z, axis);
        mesh.positions
            .iter_mut()
            .for_each(|x| *x = centre + turn * *x);
        mesh.normals
            .iter_mut()
            .for_each(|normal| *normal = (turn * normal.as_dvec3()).as_vec3());
        mesh
    }

    /// Creates a flat parallelogram from a corner and two edges; its normal is `along_u × along_v`.
    pub(super) fn quad(origin: DVec3, along_u: DVec3, along_v: DVec3) -> Self {
        Self::patch(1, 1, false, |r, c| {
            let (u, v) = (c as f64, r as f64);
            let uv = Vec2::new((u * along_u.length()) as f32, (v * along_v.length()) as f32);
            (origin + u * along_u + v * along_v, uv)
        })
    }

    /// Appends another mesh.
    pub(super) fn append(&mut self, other: Self) {
        let base = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uv.extend(other.uv);
        self.triangles
            .extend(other.triangles.into_iter().map(|t| t.map(|v| v + base)));
    }

    /// Returns the total area of the triangles in square metres; a thin sheet counts once.
    pub(super) fn area_m2(&self) -> f64 {
        self.triangles
            .iter()
            .map(|&t| 0.5 * face_normal(&self.positions, t).length())
            .sum()
    }
}

/// Returns the normal of a triangle, with twice its area as length.
pub(super) fn face_normal(positions: &[DVec3], triangle: [u32; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(|v| positions[v as usize]);
    (b - a).cross(c - a)
}

fn face_sums(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for &triangle in triangles {
        let normal = face_normal(positions, triangle);
        for vertex in triangle {
            sums[vertex as usize] += normal;
        }
    }
    sums
}

/// A point on a [`Curve`] with a right-handed orthonormal frame `tangent`, `side`, `up`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Station {
    /// Arc length from the start, in metres.
    pub(super) at_m: f64,
    pub(super) x: DVec3,
    pub(super) tangent: DVec3,
    pub(super) side: DVec3,
    pub(super) up: DVec3,
}

/// How the direction of a [`Curve`] turns along its length.
///
/// At the share `t` of the length, the direction has turned by the share `t^power` of the great
/// circle from `from` to `to`. Both are unit vectors and not opposite.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bend {
    pub(super) from: DVec3,
    pub(super) to: DVec3,
    pub(super) power: f64,
}

/// The centre line of an organ: a fine polyline with a frame of minimum rotation.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    stations: Vec<Station>,
}

impl Curve {
    const STEPS: usize = 160;

    /// Creates a curve from `start`, `length_m` long, that turns according to `bend`.
    pub(super) fn turning(start: DVec3, bend: Bend, length_m: f64, side: DVec3) -> Self {
        let Bend { from, to, power } = bend;
        let turn = DQuat::from_rotation_arc(from, to);
        let direction = |t: f64| DQuat::IDENTITY.slerp(turn, t.powf(power)) * from;
        let step = length_m / Self::STEPS as f64;
        let (mut x, mut side) = (start, side);
        let stations = (0..=Self::STEPS)
            .map(|k| {
                let t = k as f64 / Self::STEPS as f64;
                let tangent = direction(t);
                side = side.reject_from(tangent).normalize();
                let station = Station {
                    at_m: t * length_m,
                    x,
                    tangent,
                    side,
                    up: tangent.cross(side),
                };
                x += step * direction((t + 0.5 / Self::STEPS as f64).min(1.0));
                station
            })
            .collect();
        Self { stations }
    }

    /// Returns the arc length in metres.
    pub(super) fn length_m(&self) -> f64 {
        self.stations.last().map_or(0.0, |station| station.at_m)
    }

    /// Returns the point at arc length `at_m`, clamped to the ends.
    pub(super) fn at(&self, at_m: f64) -> Station {
        let place = (at_m / self.length_m()).clamp(0.0, 1.0) * (self.stations.len() - 1) as f64;
        let index = (place as usize).min(self.stations.len() - 2);
        let (a, b, f) = (
            &self.stations[index],
            &self.stations[index + 1],
            place - index as f64,
        );
        let tangent = a.tangent.lerp(b.tangent, f).normalize();
        let side = a.side.lerp(b.side, f).reject_from(tangent).normalize();
        Station {
            at_m: a.at_m + (b.at_m - a.at_m) * f,
            x: a.x.lerp(b.x, f),
            tangent,
            side,
            up: tangent.cross(side),
        }
    }

    /// Returns the last point.
    pub(super) fn end(&self) -> Station {
        self.at(self.length_m())
    }
}

/// Returns 0 below `low`, 1 above `high`, and a smooth transition between them.
pub(super) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
