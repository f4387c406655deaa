//! Small valid files of every format, written by the tests themselves.

use std::io::Cursor;

use image::codecs::tiff::TiffEncoder;
use image::{
    ExtendedColorType, ImageBuffer, ImageEncoder, ImageFormat, Luma, Rgb, RgbImage, Rgba, RgbaImage,
};
use ostra_cloud::ply::{SavedColors, save_mesh, write_ply};
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, EstimatedDepth};
use ostra_geometry::{Camera, Distortion};
use ostra_masks::{Label, LabelId, LabelTree};

use crate::harness::Seed;

pub const LABELS_JSON: &str = r#"[{"id":1,"name":"plant","color":[200,30,30],"parent":null},
{"id":2,"name":"leaf","color":[30,200,30],"parent":1}]"#;

fn color() -> RgbImage {
    RgbImage::from_fn(16, 12, |x, y| Rgb([(x * 16) as u8, (y * 20) as u8, 90]))
}

fn encoded(image: &image::DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub fn color_png() -> Vec<u8> {
    encoded(&color().into(), ImageFormat::Png)
}

pub fn images() -> Vec<Seed> {
    let alpha = RgbaImage::from_fn(16, 12, |x, y| {
        Rgba([200, 40, 90, if (x + y) % 3 == 0 { 0 } else { 255 }])
    });
    let deep: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_fn(16, 12, |x, y| Luma([(x * y * 300) as u16]));
    vec![
        Seed::new("0.png", color_png()),
        Seed::new("0.jpg", encoded(&color().into(), ImageFormat::Jpeg)),
        Seed::new("0.webp", encoded(&color().into(), ImageFormat::WebP)),
        Seed::new("0.tiff", encoded(&color().into(), ImageFormat::Tiff)),
        Seed::new(
            "0.jpg",
            with_exif(&encoded(&color().into(), ImageFormat::Jpeg)),
        ),
        Seed::new("0.png", encoded(&alpha.into(), ImageFormat::Png)),
        Seed::new("0.png", encoded(&deep.into(), ImageFormat::Png)),
    ]
}

/// Returns the JPEG with an orientation and a focal length in its EXIF data.
fn with_exif(jpeg: &[u8]) -> Vec<u8> {
    let entry = |tag: u16, kind: u16, count: u32, value: u32| {
        [
            &tag.to_le_bytes()[..],
            &kind.to_le_bytes(),
            &count.to_le_bytes(),
            &value.to_le_bytes(),
        ]
        .concat()
    };
    let mut tiff = b"II*\0\x08\0\0\0\x02\0".to_vec();
    tiff.extend(entry(0x0112, 3, 1, 6));
    tiff.extend(entry(0x8769, 4, 1, 38));
    tiff.extend([0; 4]);
    tiff.extend([1, 0]);
    tiff.extend(entry(0xa405, 3, 1, 28));
    tiff.extend([0; 4]);
    let body = [b"Exif\0\0", tiff.as_slice()].concat();
    let length = (body.len() as u16 + 2).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, &body, &jpeg[2..]].concat()
}

pub fn depths() -> Vec<Seed> {
    let steps: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_fn(16, 12, |x, y| Luma([(500 + x * 7 + y) as u16]));
    let metres: Vec<u8> = (0..16 * 12)
        .flat_map(|k| (0.5_f32 + k as f32 * 0.01).to_le_bytes())
        .collect();
    let mut float = Cursor::new(Vec::new());
    let rgb_float: Vec<u8> = metres.chunks(4).flat_map(|value| value.repeat(3)).collect();
    TiffEncoder::new(&mut float)
        .write_image(&rgb_float, 16, 12, ExtendedColorType::Rgb32F)
        .unwrap();
    vec![
        Seed::new("0.png", encoded(&steps.clone().into(), ImageFormat::Png)),
        Seed::new("0.tiff", encoded(&steps.into(), ImageFormat::Tiff)),
        Seed::new("0.tif", float.into_inner()),
        Seed::new("0.tif", estimated_depth()),
    ]
}

fn camera() -> Camera {
    Camera {
        width: 16,
        height: 12,
        focal_px: glam::DVec2::splat(20.0),
        principal_px: glam::DVec2::new(8.0, 6.0),
        distortion: Distortion::None,
    }
}

pub fn estimated_depth() -> Vec<u8> {
    let depths: Vec<f32> = (0..16 * 12).map(|k| 1.0 + k as f32 * 0.001).collect();
    let depth = DepthMap {
        width: 16,
        height: 12,
        depths,
    };
    let normals = vec![[0, 0, -127]; 16 * 12];
    EstimatedDepth {
        camera: camera(),
        depth,
        normals,
        confidence: vec![128; 16 * 12],
    }
    .encode()
    .unwrap()
}

pub fn colmap_text() -> Vec<Seed> {
    let cameras = "# Camera list\n1 PINHOLE 16 12 20 20 8 6\n2 OPENCV 16 12 20 20 8 6 0.1 -0.01 0.001 0.002\n";
    let images = "1 1 0 0 0 0 0 0 1 0.png\n3.5 4.5 1 7.5 2.5 -1\n2 0.7071 0 0.7071 0 -0.02 0 0 2 1.png\n3.25 4.5 1\n";
    let points = "1 0.1 0.2 1.5 200 10 30 0.5 1 0 2 0\n";
    vec![
        Seed::new("cameras.txt", cameras),
        Seed::new("images.txt", images),
        Seed::new("points3D.txt", points),
    ]
}

pub fn colmap_binary() -> Vec<Seed> {
    let doubles = |values: &[f64]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let longs = |values: &[u64]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let ints = |values: &[u32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let cameras = [
        longs(&[1]),
        ints(&[1, 1]),
        longs(&[16, 12]),
        doubles(&[20.0, 20.0, 8.0, 6.0]),
    ]
    .concat();
    let image = |id: u32, name: &[u8], x: f64| {
        let pose = doubles(&[1.0, 0.0, 0.0, 0.0, x, 0.0, 0.0]);
        let keypoint = [doubles(&[3.5, 4.5]), longs(&[1])].concat();
        [
            ints(&[id]),
            pose,
            ints(&[1]),
            name.to_vec(),
            vec![0],
            longs(&[1]),
            keypoint,
        ]
        .concat()
    };
    let images = [
        longs(&[2]),
        image(1, b"0.png", 0.0),
        image(2, b"1.png", -0.02),
    ]
    .concat();
    let point = [
        longs(&[1]),
        doubles(&[0.1, 0.2, 1.5]),
        vec![200, 10, 30],
        doubles(&[0.5]),
        longs(&[2]),
        ints(&[1, 0, 2, 0]),
    ];
    let points = [longs(&[1]), point.concat()].concat();
    vec![
        Seed::new("cameras.bin", cameras),
        Seed::new("images.bin", images),
        Seed::new("points3D.bin", points),
    ]
}

pub fn camera_files() -> Vec<Seed> {
    let rows = "1 0 0 0.5\n0 1 0 0\n0 0 1 -0.25\n0 0 0 1\n";
    let transforms = r#"{"fl_x": 20, "fl_y": 20, "cx": 8, "cy": 6, "w": 16, "h": 12, "camera_angle_x": 0.8, "frames": [
 {"file_path": "./0.png", "transform_matrix": [[1,0,0,0.5],[0,1,0,0],[0,0,1,-0.25],[0,0,0,1]]},
 {"file_path": "1", "k1": 0.1, "transform_matrix": [[0,0,1,0.5],[0,1,0,0],[-1,0,0,-0.25],[0,0,0,1]]}]}"#;
    let dtu = format!("extrinsic\n{rows}\nintrinsic\n20 0 8\n0 20 6\n0 0 1\n\n0.4 0.01\n");
    let middlebury = "2\n0.png 20 0 8 0 20 6 0 0 1 1 0 0 0 1 0 0 0 1 0 0 0.5\n1.png 20 0 8 0 20 6 0 0 1 1 0 0 0 1 0 0 0 1 0.1 0 0.5\n";
    vec![
        Seed::new("transforms.json", transforms),
        Seed::new(
            "poses.txt",
            "# time tx ty tz qx qy qz qw\n0 0 0 0 0 0 0 1\n1 0.02 0 0 0 0 0.7071 0.7071\n",
        ),
        Seed::new("trajectory.log", format!("0 0 1\n{rows}1 1 2\n{rows}")),
        Seed::new("pose/0.txt", rows),
        Seed::new("cams/00000000_cam.txt", dtu),
        Seed::new("temple_par.txt", middlebury),
    ]
}

pub fn intrinsics() -> Vec<Seed> {
    let json = r#"{"width": 16, "height": 12, "intrinsic_matrix": [20, 0, 0, 0, 20, 0, 8, 6, 1]}"#;
    vec![
        Seed::new("intrinsic.json", json),
        Seed::new("K.txt", "20 0 8\n0 20 6\n0 0 1\n"),
        Seed::new("K4.txt", "20 0 8 0\n0 20 6 0\n0 0 1 0\n0 0 0 1\n"),
        Seed::new("values.txt", "20,20,8,6"),
    ]
}

fn tree() -> LabelTree {
    let mut tree = LabelTree::default();
    for (id, name, parent) in [(1, "plant", None), (2, "leaf", Some(LabelId(1)))] {
        tree.set(Label {
            id: LabelId(id),
            name: name.into(),
            color: [200, 30 * id as u8, 30],
            parent,
        })
        .unwrap();
    }
    tree
}

pub fn mask_pngs() -> Vec<Seed> {
    let ids = image::GrayImage::from_fn(16, 12, |x, y| {
        Luma([u8::from(x > 4) + u8::from(x > 8 && y > 5)])
    });
    let deep: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_fn(16, 12, |x, _| Luma([u16::from(x > 4) * 300]));
    let colors = RgbImage::from_fn(16, 12, |x, _| {
        if x > 4 {
            Rgb([128, 0, 0])
        } else {
            Rgb([0, 0, 0])
        }
    });
    let mut palette = Vec::new();
    let mut encoder = png::Encoder::new(&mut palette, 16, 12);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(vec![0, 0, 0, 128, 0, 0, 0, 128, 0]);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(ids.as_raw())
        .unwrap();
    vec![
        Seed::new("0.png", palette),
        Seed::new("0.png", encoded(&ids.into(), ImageFormat::Png)),
        Seed::new("0.png", encoded(&deep.into(), ImageFormat::Png)),
        Seed::new("1.png", encoded(&colors.into(), ImageFormat::Png)),
    ]
}

pub fn binary_masks() -> Vec<Seed> {
    let soft = image::GrayImage::from_fn(16, 12, |x, _| Luma([(x * 16) as u8]));
    let alpha = RgbaImage::from_fn(16, 12, |x, _| {
        Rgba([255, 255, 255, if x > 6 { 255 } else { 0 }])
    });
    vec![
        Seed::new(
            "leaf/0.png",
            encoded(&soft.clone().into(), ImageFormat::Png),
        ),
        Seed::new("leaf/1.png", encoded(&alpha.into(), ImageFormat::Png)),
        Seed::new("0.png", encoded(&soft.into(), ImageFormat::Png)),
    ]
}

pub fn coco() -> Vec<Seed> {
    let text = r#"{"images": [{"id": 1, "file_name": "0.png", "width": 16, "height": 12}, {"id": 2, "file_name": "1.png", "width": 16, "height": 12}],
"categories": [{"id": 1, "name": "leaf", "supercategory": "rice"}, {"id": 2, "name": "stem"}],
"annotations": [
 {"id": 1, "image_id": 1, "category_id": 1, "iscrowd": 0, "area": 20.5, "bbox": [1, 1, 6, 6], "segmentation": [[1, 1, 7, 1, 7, 7, 1, 7]]},
 {"id": 2, "image_id": 1, "category_id": 2, "iscrowd": 1, "segmentation": {"size": [12, 16], "counts": [20, 10, 162]}},
 {"id": 3, "image_id": 2, "category_id": 2, "iscrowd": 1, "segmentation": {"size": [12, 16], "counts": "d0:R5"}}]}"#;
    vec![Seed::new("annotations.json", text)]
}

pub fn yolo() -> Vec<Seed> {
    vec![
        Seed::new(
            "0.txt",
            "0 0.1 0.1 0.5 0.1 0.5 0.6 0.1 0.6\n1 0.6 0.6 0.9 0.6 0.9 0.9\n",
        ),
        Seed::new("labels/1.txt", "1 0.5 0.5 0.25 0.25\n"),
        Seed::new("classes.txt", "leaf\nstem\n"),
        Seed::new("data.yaml", "train: images\nnames:\n  0: leaf\n  1: stem\n"),
    ]
}

fn cloud() -> LabelledCloud {
    let positions = (0..12)
        .map(|k| glam::Vec3::new(k as f32 * 0.1, 0.2, 1.0))
        .collect();
    let labels = (0..12).map(|k| LabelId(k % 3)).collect();
    LabelledCloud {
        labels,
        confidence: vec![0.75; 12],
        tree: tree(),
        ..LabelledCloud::from_positions(positions)
    }
}

pub fn clouds() -> Vec<Seed> {
    let mut binary = Vec::new();
    write_ply(
        &mut binary,
        &cloud(),
        SavedColors::Image,
        &Progress::default(),
    )
    .unwrap();
    let header = "ply\nformat ascii 1.0\ncomment label 1 0 leaf\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty float red\nproperty int label\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let big = "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    let values = [1.0_f64, 2.0, 3.0]
        .iter()
        .flat_map(|value| value.to_be_bytes())
        .chain([9, 8, 7]);
    vec![
        Seed::new("c.ply", binary),
        Seed::new(
            "c.ply",
            format!("{header}0 0 1 0.5 1\n1 0 1 255 -1\n3 0 1 1\n"),
        ),
        Seed::new("c.ply", big.bytes().chain(values).collect::<Vec<u8>>()),
    ]
}

pub fn meshes() -> Vec<Seed> {
    let mesh = LabelledMesh {
        vertices: cloud(),
        triangles: vec![[0, 1, 2], [2, 3, 4], [5, 6, 7]],
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ply");
    save_mesh(&path, &mesh, SavedColors::Image, &Progress::default()).unwrap();
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    vec![
        Seed::new("m.ply", std::fs::read(path).unwrap()),
        Seed::new("m.ply", text),
    ]
}
