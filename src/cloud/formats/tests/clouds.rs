use std::io::Cursor;
use std::path::Path;

use glam::Vec3;

use super::meshes::tree;
use crate::formats::CloudFormat;
use crate::ply::SavedColors;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId, LabelTree};

/// Returns 1000 points far from the origin, labelled 3, 7, 0, 3, 7 …
fn cloud() -> LabelledCloud {
    let at = |k: u16| Vec3::new(-3.0 + 0.001 * f32::from(k), 120.25, 0.5 * f32::from(k % 9));
    let mut cloud = LabelledCloud::from_positions((0..1000).map(at).collect());
    cloud.labels = (0..1000).map(|k| LabelId([3, 7, 0][k % 3])).collect();
    cloud.colors = (0..1000).map(|k| [k as u8, 100, 255]).collect();
    cloud.confidence = (0..1000).map(|k| 1.0 / (k as f32 + 1.0)).collect();
    cloud.normals.fill(Vec3::NEG_Y);
    cloud.tree = tree();
    cloud
}

fn saved(cloud: &LabelledCloud, name: &str, coloring: SavedColors) -> Result<Vec<u8>, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    CloudFormat::of(Path::new(name))?.save(&path, cloud, coloring, &Progress::default())?;
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "no temporary file stays"
    );
    Ok(std::fs::read(path).unwrap())
}

#[test]
fn las_and_laz_store_all_point_data() {
    let cloud = cloud();
    for name in ["a.las", "a.LAZ"] {
        let mut reader = las::Reader::new(Cursor::new(
            saved(&cloud, name, SavedColors::Image).unwrap(),
        ))
        .unwrap();
        assert_eq!(reader.header().version(), las::Version::new(1, 4));
        let described = reader
            .header()
            .vlrs()
            .iter()
            .find(|vlr| vlr.record_id == 4)
            .unwrap();
        assert_eq!(described.data.len(), 6 * 192);
        assert_eq!(&described.data[4..9], b"label");
        let points = reader.read_all().unwrap();
        let points: Vec<las::Point> = points.points().map(Result::unwrap).collect();
        assert_eq!(points.len(), cloud.len());
        for (k, point) in points.iter().enumerate() {
            let read = glam::DVec3::new(point.x, point.y, point.z);
            assert!(
                read.distance(cloud.positions[k].as_dvec3()) < 2e-5,
                "{name}: {read}"
            );
            let color = point.color.unwrap();
            assert_eq!(
                [color.red, color.green, color.blue],
                cloud.colors[k].map(|channel| u16::from(channel) * 257)
            );
            let short =
                |at: usize| u16::from_le_bytes([point.extra_bytes[at], point.extra_bytes[at + 1]]);
            assert_eq!(short(0), cloud.labels[k].0);
            assert_eq!(
                short(2),
                if cloud.labels[k].0 == 3 { 3 } else { 0 },
                "3 lies below 7"
            );
            assert_eq!(point.extra_bytes[4..8], cloud.confidence[k].to_le_bytes());
            let class = u8::from(point.classification);
            assert_eq!(
                class,
                if cloud.labels[k] == LabelId::NONE {
                    0
                } else {
                    64
                }
            );
        }
    }
    let [las, laz] =
        ["a.las", "a.laz"].map(|name| saved(&cloud, name, SavedColors::Image).unwrap());
    assert!(
        laz.len() < las.len() / 2,
        "{} of {} bytes",
        laz.len(),
        las.len()
    );
    assert_eq!(
        las,
        saved(&cloud, "b.las", SavedColors::Image).unwrap(),
        "the same cloud gives the same bytes"
    );
    assert_ne!(las, saved(&cloud, "b.las", SavedColors::Labels).unwrap());
}

#[test]
fn pcd_stores_all_point_data() {
    let cloud = cloud();
    let bytes = saved(&cloud, "a.pcd", SavedColors::Image).unwrap();
    let end = bytes
        .windows(12)
        .position(|window| window == b"DATA binary\n")
        .unwrap()
        + 12;
    let head = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(
        head.contains("# label 3 7 ") && head.contains("\nPOINTS 1000\n"),
        "{head}"
    );
    assert!(
        head.contains("\nFIELDS x y z normal_x normal_y normal_z rgb label confidence\n"),
        "{head}"
    );
    assert_eq!(bytes.len() - end, 1000 * 36);
    for (k, record) in bytes[end..].chunks(36).enumerate() {
        let float = |at: usize| f32::from_le_bytes(record[at..at + 4].try_into().unwrap());
        let word = |at: usize| u32::from_le_bytes(record[at..at + 4].try_into().unwrap());
        assert_eq!(Vec3::new(float(0), float(4), float(8)), cloud.positions[k]);
        assert_eq!(Vec3::new(float(12), float(16), float(20)), cloud.normals[k]);
        let [red, green, blue] = cloud.colors[k].map(u32::from);
        assert_eq!(word(24), red << 16 | green << 8 | blue);
        assert_eq!(
            (word(28), float(32)),
            (u32::from(cloud.labels[k].0), cloud.confidence[k])
        );
    }
}

#[test]
fn classes_of_top_labels_range_from_64_to_255() {
    let mut cloud = LabelledCloud::from_positions((0..300).map(|k| Vec3::X * k as f32).collect());
    let mut tree = LabelTree::default();
    for id in 1..=300_u16 {
        tree.set(Label {
            id: LabelId(id),
            name: format!("l{id}"),
            color: [9; 3],
            parent: None,
        })
        .unwrap();
    }
    cloud.tree = tree;
    cloud.labels = (1..=300).map(LabelId).collect();
    let bytes = saved(&cloud, "a.las", SavedColors::Image).unwrap();
    let points = las::Reader::new(Cursor::new(bytes))
        .unwrap()
        .read_all()
        .unwrap();
    let found: Vec<u8> = points
        .points()
        .map(|point| u8::from(point.unwrap().classification))
        .collect();
    assert_eq!(
        (found[0], found[1], found[191], found[299]),
        (64, 65, 255, 255)
    );
    let folder = tempfile::tempdir().unwrap();
    CloudFormat::save_classes(&folder.path().join("a.las"), &cloud).unwrap();
    let text = std::fs::read_to_string(folder.path().join("a.classes.json")).unwrap();
    let listed: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        listed[1],
        serde_json::json!({"id": 2, "name": "l2", "parent": null, "color": "#090909", "las_class": 65})
    );
}

#[test]
fn unwritable_clouds_give_an_error_message() {
    let said = |cloud: &LabelledCloud, name: &str| {
        saved(cloud, name, SavedColors::Image)
            .unwrap_err()
            .to_string()
    };
    assert!(said(&cloud(), "a.xyz").contains(".ply, .las, .laz or .pcd"));
    for name in ["a.ply", "a.las", "a.laz", "a.pcd"] {
        assert!(said(&LabelledCloud::default(), name).contains("no points"));
        let nowhere = CloudFormat::of(Path::new(name)).unwrap().save(
            &Path::new("/nowhere").join(name),
            &cloud(),
            SavedColors::Image,
            &Progress::default(),
        );
        assert!(nowhere.unwrap_err().to_string().contains(name));
    }
    let mut odd = cloud();
    odd.positions[5].x = f32::NAN;
    assert!(said(&odd, "a.laz").contains("without a place"));
}
