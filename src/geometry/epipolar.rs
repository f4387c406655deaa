use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::Matrix3;

use super::{Camera, Pose};

/// Returns `[t]×`, the matrix of `x ↦ t × x`.
pub(super) fn cross_matrix(t: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, t.z, -t.y),
        DVec3::new(-t.z, 0.0, t.x),
        DVec3::new(t.y, -t.x, 0.0),
    )
}

/// Returns the essential matrix `E = [t]× R`.
///
/// `x2ᵀ E x1 = 0` for rays of the same point in two cameras.
#[must_use]
pub fn essential_from_pose(second_from_first: &Pose) -> DMat3 {
    cross_matrix(second_from_first.translation) * DMat3::from_quat(second_from_first.rotation)
}

/// Returns the distance of two matching points from an essential matrix, on the plane z = 1.
///
/// This is the first-order approximation of how far the points must move to agree (R. Hartley,
/// A. Zisserman, *Multiple View Geometry in Computer Vision*, 2004, 11.4.3).
#[must_use]
pub fn sampson_distance(essential: &DMat3, [first, second]: [DVec2; 2]) -> f64 {
    let (first, second) = (first.extend(1.0), second.extend(1.0));
    let (in_second, in_first) = (*essential * first, essential.transpose() * second);
    let gradient = in_second.truncate().length_squared() + in_first.truncate().length_squared();
    second.dot(in_second).abs() / gradient.sqrt()
}

/// Converts a matrix between rays to a fundamental matrix between pixels.
///
/// Pixels are without lens distortion. The result has Frobenius norm 1.
#[must_use]
pub fn fundamental_in_pixels(between_rays: DMat3, cameras: [&Camera; 2]) -> DMat3 {
    let [to_first, to_second] = cameras.map(|camera| {
        let (f, c) = (camera.focal_px.recip(), camera.principal_px);
        DMat3::from_cols_array(&[f.x, 0.0, 0.0, 0.0, f.y, 0.0, -c.x * f.x, -c.y * f.y, 1.0])
    });
    let f = to_second.transpose() * between_rays * to_first;
    f * (1.0 / f.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt())
}

/// Returns the four poses `second_from_first` of an essential matrix, with unit translation.
///
/// For one of them, points lie in front of both cameras (R. Hartley, A. Zisserman, *Multiple View
/// Geometry in Computer Vision*, 2004, 9.6.2). Returns `None` for a matrix that is not finite.
pub(super) fn poses_from_essential(essential: DMat3) -> Option<[Pose; 4]> {
    let entries = essential.to_cols_array();
    if !entries.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = Matrix3::from_column_slice(&entries).svd(true, true);
    let (u, vt) = (
        DMat3::from_cols_slice(svd.u?.as_slice()),
        DMat3::from_cols_slice(svd.v_t?.as_slice()),
    );
    // Largest singular values first, whatever the order of the decomposition.
    let least = svd.singular_values.imin();
    let order = [(least + 1) % 3, (least + 2) % 3, least];
    let u = DMat3::from_cols(u.col(order[0]), u.col(order[1]), u.col(order[2]));
    let v = vt.transpose();
    let v = DMat3::from_cols(v.col(order[0]), v.col(order[1]), v.col(order[2]));
    let quarter = DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z);
    let rotation = |turn: DMat3| {
        let r = u * turn * v.transpose();
        DQuat::from_mat3(&(r * r.determinant().signum())).normalize()
    };
    let [a, b] = [rotation(quarter), rotation(quarter.transpose())];
    let along = u.z_axis.normalize();
    Some(
        [(a, along), (a, -along), (b, along), (b, -along)].map(|(rotation, translation)| Pose {
            rotation,
            translation,
        }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    #[test]
    fn essential_matrix_yields_its_pose_among_four() {
        let pose = Pose {
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.5, 1.1),
            translation: DVec3::new(0.6, 0.0, -0.8),
        };
        let found = poses_from_essential(-3.0 * essential_from_pose(&pose)).unwrap();
        let same = |p: &&Pose| {
            p.rotation.angle_between(pose.rotation) < 1e-7
                && p.translation.abs_diff_eq(pose.translation, 1e-9)
        };
        assert_eq!(found.iter().filter(same).count(), 1, "{found:?}");
        assert_eq!(poses_from_essential(DMat3::NAN), None);
    }

    #[test]
    fn pixels_of_one_point_satisfy_the_fundamental_matrix() {
        let pose = Pose {
            rotation: DQuat::from_rotation_y(0.2),
            translation: DVec3::new(1.0, 0.1, 0.2),
        };
        let cameras = [
            Camera::pinhole(640, 480, [500.0, 510.0], [322.0, 237.5]),
            Camera::pinhole(320, 240, [300.0, 290.0], [150.0, 99.0]),
        ];
        let f = fundamental_in_pixels(essential_from_pose(&pose), [&cameras[0], &cameras[1]]);
        let x = DVec3::new(0.4, -0.3, 4.0);
        let at: [DVec2; 2] = [
            cameras[0].project(x).unwrap(),
            cameras[1].project(pose.transform(x)).unwrap(),
        ];
        assert!(at[1].extend(1.0).dot(f * at[0].extend(1.0)).abs() < 1e-9);
        assert!(at[1].extend(1.0).dot(f * (at[0] + 20.0).extend(1.0)).abs() > 1e-4);
    }
}
