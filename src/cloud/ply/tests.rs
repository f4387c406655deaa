use std::path::Path;

use glam::Vec3;
use proptest::prelude::*;

use super::elements::Fault;
use super::read::{PlyCloud, read_from};
use super::*;
use crate::{LabelledCloud, LabelledMesh, SceneError, UNLABELLED_COLOR};
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId};

fn read(bytes: &[u8]) -> Result<PlyCloud, String> {
    read_from(&mut &bytes[..], bytes.len() as u64, &Progress::default()).map_err(
        |fault| match fault {
            Fault::Content(what) => what,
            Fault::Stopped(stopped) => stopped.to_string(),
        },
    )
}

fn written(cloud: &LabelledCloud) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_ply(&mut bytes, cloud, SavedColors::Image, &Progress::default()).unwrap();
    bytes
}

fn sample() -> LabelledCloud {
    let mut cloud = LabelledCloud::from_positions(vec![Vec3::new(1.0, -2.0, 3.5), Vec3::ZERO]);
    let label = |id, name: &str, color, parent| Label {
        id: LabelId(id),
        name: name.into(),
        color,
        parent,
    };
    cloud
        .tree
        .set(label(7, "the plant", [1, 2, 255], None))
        .unwrap();
    cloud
        .tree
        .set(label(3, "feuille été", [171, 205, 239], Some(LabelId(7))))
        .unwrap();
    cloud.labels = vec![LabelId(3), LabelId(0)];
    cloud.normals[0] = Vec3::new(0.0, 0.6, -0.8);
    cloud.colors[0] = [10, 20, 30];
    cloud.confidence[0] = 0.75;
    cloud
}

#[test]
fn written_bytes_match_the_format() {
    let bytes = written(&sample());
    let header = "ply\nformat binary_little_endian 1.0\ncomment label 3 7 feuille \\u{e9}t\\u{e9}\ncomment label 7 0 the plant\n\
                  comment color 3 abcdef\ncomment color 7 0102ff\nelement vertex 2\nproperty float x\nproperty float y\n\
                  property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\n\
                  property uchar green\nproperty uchar blue\nproperty int label\nproperty float confidence\nend_header\n";
    assert_eq!(String::from_utf8_lossy(&bytes[..header.len()]), header);
    let record = &bytes[header.len()..][..35];
    assert_eq!(record[..4], 1.0f32.to_le_bytes());
    assert_eq!(record[24..27], [10, 20, 30]);
    assert_eq!(record[27..31], [3, 0, 0, 0]);
    assert_eq!(record[31..], 0.75f32.to_le_bytes());
    assert_eq!(bytes.len(), header.len() + 70);
}

#[test]
fn sample_cloud_survives_a_round_trip() {
    let back = read(&written(&sample())).unwrap();
    assert_eq!(back.cloud, sample());
    assert!(back.has_labels && back.has_normals && back.has_colors && back.warnings.is_empty());
}

proptest! {
    #[test]
    fn any_cloud_survives_a_round_trip(points in prop::collection::vec((any::<[i16; 3]>(), any::<[u8; 3]>(), any::<u16>(), 0u8..=255), 0..40)) {
        let mut cloud = LabelledCloud::from_positions(points.iter().map(|p| Vec3::from_array(p.0.map(f32::from)) * 0.01).collect());
        cloud.colors = points.iter().map(|p| p.1).collect();
        cloud.labels = points.iter().map(|p| LabelId(p.2)).collect();
        cloud.confidence = points.iter().map(|p| f32::from(p.3) / 255.0).collect();
        cloud.normals = points.iter().map(|p| Vec3::from_array(p.0.map(f32::from)).normalize_or_zero()).collect();
        crate::labelled_cloud::name_unknown_labels(&mut cloud.tree, cloud.labels.clone());
        prop_assert_eq!(read(&written(&cloud)).unwrap().cloud, cloud);
    }

    #[test]
    fn truncated_or_changed_bytes_never_panic(cut in 0usize..700, at in 0usize..700, value in any::<u8>()) {
        let mut bytes = written(&sample());
        let full = bytes.len();
        let (cut, at) = (cut.min(full), at.min(full - 1));
        bytes[at] = value;
        let _ = read(&bytes);
        bytes.truncate(cut);
        if cut < full {
            prop_assert!(read(&bytes).is_err());
        }
    }
}

#[test]
fn ascii_files_with_other_orders_lists_and_names_are_read() {
    let text = "ply\r\nformat ascii 1.0\r\ncomment made by hand\r\nelement camera 1\r\nproperty list uchar int what\r\n\
                element vertex 3\r\nproperty int scalar_Label\r\nproperty list uchar float extra\r\nproperty double z\r\n\
                property double y\r\nproperty double x\r\nproperty float scalar_Scalar_field_#2\r\nelement face 9\r\n\
                property list uchar int vertex_indices\r\nend_header\r\n3 1 2 3\r\n5 2 .5 1. 3 2 1e0 0\r\n\r\n0 0 nan 2 1 0\r\n65535 0 9 8 7 0\r\n";
    let back = read(text.as_bytes()).unwrap();
    assert_eq!(
        back.cloud.positions,
        [Vec3::new(1.0, 2.0, 3.0), Vec3::new(7.0, 8.0, 9.0)]
    );
    assert_eq!(back.cloud.labels, [LabelId(5), LabelId(65535)]);
    assert_eq!(back.cloud.confidence, [1.0, 1.0]);
    assert_eq!(back.cloud.tree.get(LabelId(5)).unwrap().name, "5");
    assert_eq!(back.cloud.normals, [Vec3::ZERO; 2]);
    assert!(!back.has_colors && !back.has_normals && back.has_labels);
    assert!(
        back.warnings[0].starts_with("1 points without"),
        "{:?}",
        back.warnings
    );
}

#[test]
fn big_endian_files_with_lists_and_float_colors_are_read() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\ncomment caf\xe9\nelement face 2\nproperty list uchar uint v\nelement vertex 1\n\
        property double x\nproperty double y\nproperty double z\nproperty float red\nproperty float green\nproperty float blue\n\
        property list ushort short extra\nproperty uchar classification\nend_header\n"
        .to_vec();
    for face in [&[1u32, 2, 3][..], &[4, 5, 6, 7]] {
        bytes.push(face.len() as u8);
        face.iter()
            .for_each(|index| bytes.extend(index.to_be_bytes()));
    }
    [1.5f64, 2.5, -3.5]
        .iter()
        .for_each(|v| bytes.extend(v.to_be_bytes()));
    [0.0f32, 0.5, 1.0]
        .iter()
        .for_each(|v| bytes.extend(v.to_be_bytes()));
    bytes.extend([0, 2, 9, 9, 9, 9, 200]);
    let back = read(&bytes).unwrap();
    assert_eq!(back.cloud.positions, [Vec3::new(1.5, 2.5, -3.5)]);
    assert_eq!(back.cloud.colors, [[0, 128, 255]]);
    assert_eq!(back.cloud.labels, [LabelId(200)]);
}

#[test]
fn best_ranked_property_names_win() {
    let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float x\nproperty float y\nproperty float z\n\
                property uchar class\nproperty float scalar_label\nproperty uchar red\nend_header\n1 9 2 3 8 4 77\n";
    let back = read(text.as_bytes()).unwrap();
    assert_eq!(back.cloud.positions, [Vec3::new(1.0, 2.0, 3.0)]);
    assert_eq!(back.cloud.labels, [LabelId(4)]);
}

#[test]
fn errors_say_what_is_wrong() {
    let header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nproperty int label\nend_header\n";
    let fault = |text: String| read(text.as_bytes()).unwrap_err();
    assert!(fault(format!("{header}1 2 3 1.5\n")).contains("label 1.5"));
    assert!(fault(format!("{header}1 2 3 65536\n")).contains("label 65536"));
    assert!(fault(format!("{header}1 2 3\n")).contains("fewer numbers"));
    assert!(fault(format!("{header}1 2 3 a\n")).contains("'a' is not a number"));
    assert!(fault(header.to_string()).contains("cut off"));
    assert!(fault("obj\n".into()).contains("not a PLY file"));
    assert!(fault("ply\nformat ascii 1.0\nelement vertex 3\n".into()).contains("end_header"));
    assert!(
        fault("ply\nformat ascii 1.0\nelement face 0\nproperty int a\nend_header\n".into())
            .contains("no element 'vertex'")
    );
    assert!(
        fault("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nend_header\n".into())
            .contains("'z'")
    );
    assert!(
        fault(
            "ply\nformat ascii 1.0\nelement a 0\nelement a 0\nelement vertex 0\nend_header\n"
                .into()
        )
        .contains("same name")
    );
    assert!(fault("ply\nformat ebcdic 1.0\nend_header\n".into()).contains("cannot be understood"));
}

#[test]
fn header_with_too_many_points_is_an_error() {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement empty {0}\nelement vertex {0}\nproperty float x\nproperty float y\nproperty float z\nend_header\nabc",
        u64::MAX / 2
    );
    assert!(read(header.as_bytes()).unwrap_err().contains("ends early"));
}

#[test]
fn element_counts_are_checked_against_the_file_size() {
    let vertices = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    for (encoding, points) in [
        ("ascii", &b"0 0 0\n"[..]),
        ("binary_little_endian", &[0; 12]),
    ] {
        for (properties, what) in [
            ("", "faces"),
            ("property list uchar int vertex_indices\n", "'face'"),
        ] {
            let mut bytes = format!(
                "ply\nformat {encoding} 1.0\n{vertices}element face 9223372036854775807\n{properties}end_header\n"
            )
            .into_bytes();
            bytes.extend(points);
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("m.ply");
            std::fs::write(&path, &bytes).unwrap();
            let error = super::read_mesh(&path, &Progress::default())
                .unwrap_err()
                .to_string();
            assert!(error.contains(what) || error.contains("'face'"), "{error}");
        }
    }
}

#[test]
fn labels_that_mean_none_become_unlabelled_with_a_warning() {
    for (kind, stored) in [
        ("int", "-1"),
        ("int", "-100"),
        ("float", "nan"),
        ("float", "-1"),
        ("uint", "4294967295"),
    ] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty {kind} label\nend_header\n1 2 3 {stored}\n1 2 3 4\n"
        );
        let read = read(text.as_bytes()).unwrap();
        assert_eq!(read.cloud.labels, [LabelId(0), LabelId(4)]);
        assert!(
            read.warnings[0].starts_with("1 points have a label that means none"),
            "{:?}",
            read.warnings
        );
    }
}

#[test]
fn colour_range_is_derived_from_the_values() {
    for (kind, stored, expected, warnings) in [
        ("float", "0 0.5 1", [0, 128, 255], 0),
        ("float", "0 127.6 255", [0, 128, 255], 1),
        ("double", "3 200 40", [3, 200, 40], 1),
        ("float", "-1 nan 0.5", [0, 0, 128], 1),
        ("ushort", "0 32896 65535", [0, 128, 255], 0),
        ("ushort", "0 128 255", [0, 128, 255], 0),
        ("int", "0 128 255", [0, 128, 255], 0),
        ("uchar", "0 1 255", [0, 1, 255], 0),
    ] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nproperty {kind} red\nproperty {kind} green\nproperty {kind} blue\nend_header\n1 2 3 {stored}\n"
        );
        let read = read(text.as_bytes()).unwrap();
        assert_eq!(read.cloud.colors, [expected], "{kind} {stored}");
        assert_eq!(
            read.warnings.len(),
            warnings,
            "{kind} {stored}: {:?}",
            read.warnings
        );
    }
}

#[test]
fn byte_order_marks_are_skipped() {
    let header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for text in [
        format!("\u{feff}{header}1 2 3\n"),
        format!("{header}\u{feff}1 2 3\n"),
    ] {
        assert_eq!(
            read(text.as_bytes()).unwrap().cloud.positions,
            [Vec3::new(1.0, 2.0, 3.0)]
        );
    }
}

#[test]
fn labels_with_equal_names_in_a_chain_are_numbered() {
    let comments: Vec<String> = (1..=65_535)
        .map(|id| format!("label {id} {} a", id - 1))
        .collect();
    let tree = super::comments::tree_from_comments(&comments);
    assert_eq!(tree.iter().count(), 65_535);
    assert_eq!(
        [1, 2, 3].map(|id| tree.get(LabelId(id)).unwrap().name.as_str()),
        ["a", "a (2)", "a (3)"]
    );
    assert!(
        tree.iter()
            .all(|label| tree.depth(label.id) <= ostra_masks::MAX_DEPTH)
    );
}

#[test]
fn damaged_label_comments_still_give_a_tree() {
    let text = "ply\nformat ascii 1.0\ncomment label 1 2 a\ncomment label 2 1 b\ncomment label 3 9 c\ncomment label 4 0 a\n\
                comment label x 0 y\ncomment label 0 0 z\ncomment color 1 12345\ncomment color 2 010203\nelement vertex 0\n\
                property float x\nproperty float y\nproperty float z\nend_header\n";
    let tree = read(text.as_bytes()).unwrap().cloud.tree;
    let names: Vec<_> = tree
        .iter()
        .map(|label| (label.id.0, label.name.as_str()))
        .collect();
    assert_eq!(names, [(1, "a"), (2, "b"), (3, "c"), (4, "a (2)")]);
    assert_eq!(tree.get(LabelId(2)).unwrap().color, [1, 2, 3]);
}

#[test]
fn parts_and_label_colour_copy_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    let progress = Progress::default();
    let save =
        |path: &Path, part: &LabelledCloud| save_ply(path, part, SavedColors::Image, &progress);
    let files = save_per_label(&path, &sample(), save).unwrap();
    let names: Vec<_> = files
        .iter()
        .map(|f| f.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names, ["cloud_unlabelled.ply", "cloud_feuille_été.ply"]);
    let part = read_ply(&files[1], &progress).unwrap().cloud;
    assert_eq!(
        (part.len(), part.labels[0], &part.tree),
        (1, LabelId(3), &sample().tree)
    );
    save_ply(&twin_path(&path), &sample(), SavedColors::Labels, &progress).unwrap();
    let twin = read_ply(&folder.path().join("cloud_labels.ply"), &progress)
        .unwrap()
        .cloud;
    assert_eq!(twin.colors, [[171, 205, 239], UNLABELLED_COLOR]);
    assert_eq!(twin.positions, sample().positions);
}

#[test]
fn stopped_or_failed_save_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    save_ply(&path, &sample(), SavedColors::Image, &Progress::default()).unwrap();
    let before = std::fs::read(&path).unwrap();
    let stopped = Progress::default();
    stopped.stop();
    let result = save_ply(&path, &sample(), SavedColors::Labels, &stopped);
    assert!(matches!(result, Err(SceneError::Stopped(_))));
    assert_eq!(std::fs::read(&path).unwrap(), before);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let missing = folder.path().join("no/where.ply");
    assert!(
        save_ply(
            &missing,
            &sample(),
            SavedColors::Image,
            &Progress::default()
        )
        .unwrap_err()
        .to_string()
        .contains("no/where")
    );
}

#[test]
fn mesh_survives_a_round_trip_and_can_be_read_as_a_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    let mut vertices = sample();
    vertices.push_copy(&sample(), 0, Vec3::Y, Vec3::Z);
    let mesh = LabelledMesh {
        vertices,
        triangles: vec![[0, 1, 2], [2, 1, 0]],
    };
    let progress = Progress::default();
    save_mesh(&path, &mesh, SavedColors::Image, &progress).unwrap();
    assert!(read_mesh(&path, &progress).unwrap() == mesh);
    assert!(read_ply(&path, &progress).unwrap().cloud == mesh.vertices);
    let cloud = folder.path().join("cloud.ply");
    save_ply(&cloud, &sample(), SavedColors::Image, &progress).unwrap();
    assert!(
        read_mesh(&cloud, &progress)
            .unwrap_err()
            .to_string()
            .contains("no faces")
    );
}

#[test]
fn ascii_meshes_with_larger_faces_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let read = |faces: &str| {
        let path = folder.path().join("other.ply");
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             element edge 1\nproperty int a\nelement face 1\nproperty float quality\n\
             property list uchar uint vertex_index\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n7\n{faces}\n"
        );
        std::fs::write(&path, text).unwrap();
        read_mesh(&path, &Progress::default())
            .map(|mesh| mesh.triangles)
            .map_err(|error| error.to_string())
    };
    assert_eq!(read("0.5 4 0 1 2 3").unwrap(), [[0, 1, 2], [0, 2, 3]]);
    assert!(read("0.5 3 0 1 4").unwrap_err().contains("not there"));
    assert!(read("0.5 3 0 -1 2").unwrap_err().contains("not there"));
    assert!(read("0.5 3 0 1").unwrap_err().contains("damaged"));
    assert!(
        read("0.5 3 0 1 x")
            .unwrap_err()
            .contains("not a whole number")
    );
}

#[test]
fn origin_is_near_most_points_whatever_the_first_one_is() {
    let file = |points: &[[f64; 3]]| {
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
        text += "property double x\nproperty double y\nproperty double z\nend_header\n";
        points
            .iter()
            .for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
        read(text.as_bytes()).unwrap().cloud
    };
    let utm = |k: usize| [500_012.125 + k as f64 * 0.001, 5_400_031.5, 312.0];
    for holes in [0, 1, 40] {
        let points: Vec<[f64; 3]> = (0..holes)
            .map(|_| [0.0; 3])
            .chain((0..5000).map(utm))
            .collect();
        let cloud = file(&points);
        assert_eq!(
            cloud.origin.to_array(),
            [500_000.0, 5_400_000.0, 300.0],
            "{holes} points at zero first"
        );
        for (at, exact) in cloud.positions.iter().zip(&points).skip(holes) {
            let off = (at.as_dvec3() + cloud.origin - glam::DVec3::from_array(*exact))
                .abs()
                .max_element();
            assert!(off < 1e-4, "{off}");
        }
    }
    let stray = file(&[[1e7, 0.0, 0.0], [0.125, 0.5, 1.0], [0.25, 0.5, 1.0]]);
    assert_eq!(
        (stray.origin, stray.positions[1]),
        (glam::DVec3::ZERO, Vec3::new(0.125, 0.5, 1.0))
    );
}
