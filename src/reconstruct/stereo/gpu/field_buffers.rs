use super::data::{LevelData, TurnData};
use super::kernels::Kernels;
use crate::stereo::patchmatch::{Color, Field, Plane, PlanePrior, SearchLevel};
use ostra_compute::gpu::{Bindings, Buffer, Device, GpuError};

/// A field on the device, bound together with all input of the passes over it.
#[derive(Debug)]
pub struct DeviceField {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Red pixels, then black ones: inverse depth, slope, cost.
    pub values: Buffer,
    /// Rewritten for each dispatch.
    pub turn: Buffer,
    /// All buffers of a level.
    pub bindings: Bindings,
}

impl DeviceField {
    /// Allocates a level's field, all zeros, and its images.
    ///
    /// # Errors
    /// [`GpuError`] if the device has too little memory.
    pub fn new(kernels: &Kernels, level: &SearchLevel<'_>) -> Result<Self, GpuError> {
        let device = &*kernels.device;
        let (width, height) = (level.image.width, level.image.height);
        let values = device.zeros::<[f32; 4]>("hypotheses", 2 * width.div_ceil(2) * height)?;
        let (texels, firsts) = texels(device, level)?;
        let image = device.upload("pixels", &level.image.quads)?;
        let guides = device.upload("guides", &guides(level))?;
        let [depth, right, down] = found(device, level, &firsts)?;
        let data = device.uniform("level", &LevelData::new(level, &firsts))?;
        let turn = device.uniform("turn", &TurnData::scoring(0, 0..0))?;
        let chromas = chromas(device, level, &firsts)?;
        let buffers = [
            &data, &turn, &image, &texels, &guides, &depth, &right, &down, &chromas, &values,
        ];
        let bindings = device.bind(&kernels.patchmatch, &buffers)?;
        Ok(Self {
            size: [width as u32, height as u32],
            values,
            turn,
            bindings,
        })
    }
}

/// Converts a field to the layout of the device.
pub fn packed(field: &Field) -> Vec<[f32; 4]> {
    let pack = |(plane, &cost): (&Plane, &f32)| {
        [plane.inverse_depth, plane.slope[0], plane.slope[1], cost]
    };
    field
        .colors
        .iter()
        .flat_map(|color| color.planes.iter().zip(&color.costs).map(pack))
        .collect()
}

/// Reverses [`packed`].
pub fn unpacked(values: &[[f32; 4]], [width, height]: [u32; 2]) -> Field {
    let (width, height) = (width as usize, height as usize);
    let (red, black) = values.split_at(values.len() / 2);
    let color = |values: &[[f32; 4]]| Color {
        planes: values
            .iter()
            .map(|&[inverse_depth, a, b, _]| Plane {
                inverse_depth,
                slope: [a, b],
            })
            .collect(),
        costs: values.iter().map(|value| value[3]).collect(),
    };
    Field {
        width,
        height,
        colors: [color(red), color(black)],
    }
}

/// Uploads the images of all sources, one after the other; also returns the first texel of each.
fn texels(device: &Device, level: &SearchLevel<'_>) -> Result<(Buffer, Vec<usize>), GpuError> {
    let mut firsts = vec![0];
    for source in &level.sources {
        firsts.push(firsts[firsts.len() - 1] + source.texture.quads.len());
    }
    let texels = device.zeros::<u32>("pixels of the sources", firsts[firsts.len() - 1])?;
    for (source, &first) in level.sources.iter().zip(&firsts) {
        device.write(&texels, first, &source.texture.quads)?;
    }
    Ok((texels, firsts))
}

/// Uploads the chroma of the image, then of all sources.
fn chromas(device: &Device, level: &SearchLevel<'_>, firsts: &[usize]) -> Result<Buffer, GpuError> {
    let own = level.image.chroma.len();
    let chromas = device.zeros::<u32>("colours", own + firsts[firsts.len() - 1])?;
    let sources = level
        .sources
        .iter()
        .zip(firsts)
        .map(|(source, &first)| (own + first, &source.texture));
    for (first, texture) in [(0, &level.image)].into_iter().chain(sources) {
        let packed: Vec<u32> = texture
            .chroma
            .iter()
            .map(|&[blue, red]| u32::from_le_bytes([blue, red, 0, 0]))
            .collect();
        device.write(&chromas, first, &packed)?;
    }
    Ok(chromas)
}

/// Returns for each pixel its hint, and flags for being processed (1) and for a known surface (2).
///
/// Empty if all pixels are processed and there are no hints.
fn guides(level: &SearchLevel<'_>) -> Vec<[f32; 4]> {
    if level.allowed.is_none() && level.hints.is_empty() {
        return Vec::new();
    }
    let guide = |at: usize| {
        let PlanePrior { plane, is_known } = level.hints.get(at).copied().unwrap_or_default();
        let is_allowed = level.allowed.is_none_or(|allowed| allowed[at]);
        let state = if is_allowed {
            1 + u8::from(is_known)
        } else {
            0
        };
        [
            plane.inverse_depth,
            plane.slope[0],
            plane.slope[1],
            f32::from(state),
        ]
    };
    (0..level.image.width * level.image.height)
        .map(guide)
        .collect()
}

/// Uploads the planes found in the sources, each component separately, in the order of the texels.
///
/// Empty if no source has any.
fn found(
    device: &Device,
    level: &SearchLevel<'_>,
    firsts: &[usize],
) -> Result<[Buffer; 3], GpuError> {
    let is_any = level.sources.iter().any(|source| source.found.is_some());
    let count = if is_any { firsts[firsts.len() - 1] } else { 0 };
    let room = || device.zeros::<f32>("depths of the sources", count);
    let buffers = [room()?, room()?, room()?];
    for (source, &first) in level.sources.iter().zip(firsts) {
        let Some(found) = &source.found else {
            continue;
        };
        let parts: [fn(&Plane) -> f32; 3] = [|p| p.inverse_depth, |p| p.slope[0], |p| p.slope[1]];
        for (buffer, part) in buffers.iter().zip(parts) {
            device.write(
                buffer,
                first,
                &found.planes.planes.iter().map(part).collect::<Vec<f32>>(),
            )?;
        }
    }
    Ok(buffers)
}
