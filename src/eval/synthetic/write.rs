use std::fmt::Write as _;
use std::fs;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use super::scene::Scene;
use super::view::SyntheticView;
use ostra_cloud::SceneError;
use ostra_cloud::measure::{LengthUnit, traits_csv};
use ostra_core::disk::{self, AtomicFile};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};
use ostra_masks::{LabelMask, LabelTree};

impl Scene {
    /// Metres per step of the 16-bit depth images.
    ///
    /// The step resolves grains, and the range (6.5 m) includes the wall.
    pub const DEPTH_UNIT_M: f64 = 0.0001;

    /// Writes the scene as a recording with its ground truth.
    ///
    /// The recording consists of `color/NAME.png`, `depth/NAME.png` (16 bit,
    /// [`Self::DEPTH_UNIT_M`]) and `sparse/` (COLMAP text). The ground truth consists of
    /// `truth/masks/NAME.png` (palette, value = label id), `truth/labels.json` and
    /// `truth/traits.csv`.
    ///
    /// # Errors
    /// Returns [`SceneError::Io`] with the file, and [`SceneError::Stopped`] if stopped.
    pub fn write(&self, dir: &Path, progress: &Progress) -> Result<(), SceneError> {
        let [color, depth, masks] = [
            dir.join("color"),
            dir.join("depth"),
            dir.join("truth").join("masks"),
        ];
        for folder in [&color, &depth, &masks] {
            fs::create_dir_all(folder).map_err(io_error(folder))?;
        }
        progress.stage("render")?;
        for (k, view) in self.views().iter().enumerate() {
            progress.step(k, self.views().len())?;
            let rendered = self.render(view);
            let file = format!("{}.png", view.name);
            write_image(&color.join(&file), &rendered.image)?;
            write_depth(&depth.join(&file), &rendered.depth, Self::DEPTH_UNIT_M)?;
            write_mask(&masks.join(&file), &rendered.mask, self.tree())?;
        }
        write_cameras(&dir.join("sparse"), self.views())?;
        let labels = serde_json::to_string_pretty(&self.tree().iter().collect::<Vec<_>>())
            .map_err(|source| {
                SceneError::Request(format!("the labels cannot be written: {source}"))
            })?;
        write_text(&dir.join("truth").join("labels.json"), &labels)?;
        write_text(
            &dir.join("truth").join("traits.csv"),
            &traits_csv(self.traits(), LengthUnit::Metre),
        )
    }
}

impl Scene {
    /// Writes only the images and the true cameras, as [`Self::write`] does.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_photos(&self, dir: &Path, progress: &Progress) -> Result<(), SceneError> {
        let color = dir.join("color");
        fs::create_dir_all(&color).map_err(io_error(&color))?;
        progress.stage("render")?;
        for (k, view) in self.views().iter().enumerate() {
            progress.step(k, self.views().len())?;
            let image = self.render(view).image;
            write_image(&color.join(format!("{}.png", view.name)), &image)?;
        }
        write_cameras(&dir.join("sparse"), self.views())
    }
}

fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> SceneError {
    let path: PathBuf = path.to_owned();
    move |reason| SceneError::Io { path, reason }
}

fn write_text(path: &Path, text: &str) -> Result<(), SceneError> {
    disk::write(path, text.as_bytes()).map_err(io_error(path))
}

/// PNG encoder that writes to a buffered file.
type PngEncoder<'a> = png::Encoder<'a, BufWriter<&'a mut fs::File>>;

fn encode_png(
    path: &Path,
    width: u32,
    height: u32,
    set: impl FnOnce(&mut PngEncoder<'_>),
    bytes: &[u8],
) -> Result<(), SceneError> {
    let mut file = AtomicFile::create(path).map_err(io_error(path))?;
    let mut encoder = png::Encoder::new(BufWriter::new(file.as_file()), width, height);
    set(&mut encoder);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(bytes)?;
        writer.finish()
    });
    written.map_err(|source| io_error(path)(std::io::Error::other(source)))?;
    file.commit().map_err(io_error(path))
}

fn write_image(path: &Path, image: &Image) -> Result<(), SceneError> {
    let set = |encoder: &mut PngEncoder<'_>| {
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::Fast);
    };
    encode_png(
        path,
        image.width,
        image.height,
        set,
        image.pixels.as_flattened(),
    )
}

fn write_depth(path: &Path, depth: &DepthMap, unit_m: f64) -> Result<(), SceneError> {
    let step = |&z: &f32| {
        let steps = (f64::from(z) / unit_m).round();
        if steps < 65_535.0 { steps as u16 } else { 0 }
    };
    let bytes: Vec<u8> = depth
        .depths
        .iter()
        .flat_map(|z| step(z).to_be_bytes())
        .collect();
    let set = |encoder: &mut PngEncoder<'_>| {
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.set_compression(png::Compression::Fast);
    };
    encode_png(path, depth.width, depth.height, set, &bytes)
}

/// Writes a mask with one byte per pixel: the scenes have fewer than 256 labels.
fn write_mask(path: &Path, mask: &LabelMask, tree: &LabelTree) -> Result<(), SceneError> {
    let bytes: Vec<u8> = mask.ids.iter().map(|id| id.0 as u8).collect();
    let mut palette = vec![0; 3 * usize::from(tree.next_id().0)];
    for label in tree.iter() {
        palette[3 * usize::from(label.id.0)..][..3].copy_from_slice(&label.color);
    }
    let set = |encoder: &mut PngEncoder<'_>| {
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_palette(palette);
    };
    encode_png(path, mask.width, mask.height, set, &bytes)
}

/// Writes a COLMAP text model: one PINHOLE camera for all views, a pose for each, no points.
fn write_cameras(dir: &Path, views: &[SyntheticView]) -> Result<(), SceneError> {
    fs::create_dir_all(dir).map_err(io_error(dir))?;
    let (mut cameras, mut images) = (
        String::from("# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n"),
        String::from("# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n"),
    );
    if let Some(camera) = views.first().map(|view| &view.camera) {
        let (f, c) = (camera.focal_px, camera.principal_px);
        let _ = writeln!(
            cameras,
            "1 PINHOLE {} {} {} {} {} {}",
            camera.width, camera.height, f.x, f.y, c.x, c.y
        );
    }
    for view in views {
        let (q, t) = (
            view.camera_from_world.rotation,
            view.camera_from_world.translation,
        );
        let id = view.index + 1;
        let _ = writeln!(
            images,
            "{id} {} {} {} {} {} {} {} 1 {}.png\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z, view.name
        );
    }
    write_text(&dir.join("cameras.txt"), &cameras)?;
    write_text(&dir.join("images.txt"), &images)?;
    write_text(
        &dir.join("points3D.txt"),
        "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n",
    )
}
