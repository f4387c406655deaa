//! GPU tests of drawing, compared with the CPU's images.

use std::sync::Arc;

use glam::Vec3;

use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_frames::Image;
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_view::{
    Appearance, Axes, Bounds, Clip, Coloring, ImagePlane, Orbit, Scene3d, SceneModel, SceneStyle,
    SceneView, ViewCamera, draw_cloud, draw_mesh,
};

/// A view with the device it draws on.
pub struct View {
    scene_view: SceneView,
    device: wgpu::Device,
    queue: wgpu::Queue,
}

impl View {
    pub fn new() -> Self {
        Self::open().unwrap()
    }

    /// Opens a view, or returns why there is no device for it.
    pub fn open() -> Result<Self, String> {
        let instance = wgpu::Instance::default();
        let options = wgpu::RequestAdapterOptions::default();
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|error| error.to_string())?;
        if adapter.get_info().backend == wgpu::Backend::Gl {
            return Err("the only adapter is OpenGL, which cannot draw the 3-D view".to_owned());
        }
        let (device, queue) = pollster::block_on(adapter.request_device(&Default::default()))
            .map_err(|error| error.to_string())?;
        Ok(Self {
            scene_view: SceneView::new(&device, &queue),
            device,
            queue,
        })
    }

    pub fn set_model(&mut self, model: SceneModel) {
        self.scene_view.set_model(model);
    }

    pub fn draw(&mut self, scene: &Scene3d) -> bool {
        self.scene_view.draw(scene)
    }

    /// Returns the number of drawn points or triangles, and the number of all.
    pub fn drawn(&self) -> (usize, usize) {
        self.scene_view.drawn()
    }
}

pub fn sphere(points: usize) -> LabelledCloud {
    let mut tree = LabelTree::default();
    for id in 1..=2 {
        tree.set(Label {
            id: LabelId(id),
            name: format!("{id}"),
            color: [200, id as u8 * 90, 30],
            parent: None,
        })
        .unwrap();
    }
    let at = |i: usize| {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / points as f32;
        let (s, c) = (i as f32 * 2.399_963).sin_cos();
        Vec3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z)
    };
    LabelledCloud {
        positions: (0..points).map(at).collect(),
        normals: (0..points).map(at).collect(),
        colors: vec![[90, 90, 90]; points],
        labels: (0..points)
            .map(|i| LabelId(1 + (i * 2 / points) as u16))
            .collect(),
        confidence: vec![1.0; points],
        tree,
        ..LabelledCloud::default()
    }
}

pub fn read_back(view: &View, width: u32, height: u32) -> Vec<[u8; 4]> {
    let buffer = view.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(width * height * 4),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = view.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        view.scene_view.texture().unwrap().texture().as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * 4),
                rows_per_image: None,
            },
        },
        wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
    );
    view.queue.submit([encoder.finish()]);
    buffer
        .slice(..)
        .map_async(wgpu::MapMode::Read, |result| result.unwrap());
    view.device
        .poll(wgpu::PollType::wait_indefinitely())
        .unwrap();
    bytemuck::cast_slice(&buffer.slice(..).get_mapped_range().unwrap()).to_vec()
}

/// Draws once and returns whether the image is complete.
///
/// Yields to other threads if not, because points are arranged in the background.
pub fn step(view: &mut View, scene: &Scene3d) -> bool {
    let whole = view.draw(scene);
    if !whole {
        std::thread::yield_now();
    }
    whole
}

/// Draws until the image is complete; returns it and the number of calls.
pub fn drawn(view: &mut View, scene: &Scene3d) -> (Vec<[u8; 4]>, usize) {
    let calls = (1..50_000_000).find(|_| step(view, scene)).unwrap();
    (
        read_back(view, scene.camera.width, scene.camera.height),
        calls,
    )
}

pub fn scene(camera: ViewCamera, style: &SceneStyle) -> Scene3d {
    Scene3d {
        camera,
        style: style.clone(),
        lines: Vec::new(),
        planes: Vec::new(),
        over: None,
    }
}

pub fn by_label() -> SceneStyle {
    let appearance = Appearance {
        coloring: Coloring::Label,
        ..Default::default()
    };
    SceneStyle {
        appearance,
        ..Default::default()
    }
}

/// Returns how many of a thousand pixels differ by at most `most` in each channel.
pub fn alike(gpu: &[[u8; 4]], cpu: &[[u8; 3]], most: u8) -> usize {
    let near =
        |(g, c): &(&[u8; 4], &[u8; 3])| g[..3].iter().zip(*c).all(|(a, b)| a.abs_diff(*b) <= most);
    gpu.iter().zip(cpu).filter(near).count() * 1000 / gpu.len()
}

/// Returns a wavy square of `side` × `side` cells of two triangles each.
///
/// Its right half has another label.
fn waves(side: u32) -> LabelledMesh {
    let at = |i: u32| {
        let (x, y) = (
            (i % (side + 1)) as f32 / side as f32,
            (i / (side + 1)) as f32 / side as f32,
        );
        Vec3::new(x, y, 0.05 * (x * 20.0).sin() * (y * 15.0).cos())
    };
    let count = (side + 1) * (side + 1);
    let mut vertices = sphere(count as usize);
    vertices.positions = (0..count).map(at).collect();
    vertices.labels = (0..count)
        .map(|i| LabelId(1 + u16::from(i % (side + 1) > side / 2)))
        .collect();
    let corners = (0..side * side).map(|i| i / side * (side + 1) + i % side);
    let triangles = corners
        .flat_map(|a| {
            [
                [a, a + 1, a + side + 1],
                [a + 1, a + side + 2, a + side + 1],
            ]
        })
        .collect();
    let mut mesh = LabelledMesh {
        vertices,
        triangles,
    };
    mesh.compute_normals();
    mesh
}

fn surface_equals_its_cpu_twin_and_contains_its_wires() {
    let mesh = Arc::new(waves(400).split_at_labels());
    let bounds = Bounds::of(mesh.vertices.positions.iter().copied()).unwrap();
    let camera = Orbit::framing(&bounds, Vec3::new(0.3, 0.2, 1.0), Vec3::NEG_Y).camera(256, 192);
    let mut style = by_label();
    let mut view = View::new();
    view.set_model(SceneModel::Surface(Arc::clone(&mesh)));
    let (gpu, calls) = drawn(&mut view, &scene(camera, &style));
    assert!(calls > 1 && view.drawn() == (mesh.triangles.len(), mesh.triangles.len()));
    let cpu = draw_mesh(&mesh, &camera, &style).image;
    let same = alike(&gpu, &cpu.pixels, 2);
    assert!(same >= 985, "{same} of 1000 pixels agree");
    let covered = |pixels: &[[u8; 4]]| {
        pixels
            .iter()
            .filter(|pixel| pixel[..3] != style.background)
            .count()
    };
    let whole = covered(&gpu);
    style.appearance.hidden.insert(LabelId(2));
    let (half, _) = drawn(&mut view, &scene(camera, &style));
    assert!(
        (35..65).contains(&(covered(&half) * 100 / whole)),
        "{} of {whole}",
        covered(&half)
    );

    // On a coarse mesh, the edges leave most of the surface open, and no line lies outside it.
    let coarse = Arc::new(waves(12));
    style.appearance.hidden.clear();
    view.set_model(SceneModel::Wireframe(Arc::clone(&coarse)));
    let (wires, _) = drawn(&mut view, &scene(camera, &style));
    view.set_model(SceneModel::Surface(coarse));
    let (solid, _) = drawn(&mut view, &scene(camera, &style));
    assert!(
        (15..70).contains(&(covered(&wires) * 100 / covered(&solid))),
        "{}",
        covered(&wires)
    );
    let is_drawn = |pixel: &[u8; 4]| pixel[..3] != style.background;
    let near_solid = |at: usize| {
        let around = [0, 1, 255, 256, 257]
            .into_iter()
            .flat_map(|step| [at.checked_sub(step), at.checked_add(step)]);
        around
            .flatten()
            .any(|other| solid.get(other).is_some_and(is_drawn))
    };
    let apart = (0..wires.len())
        .filter(|&at| is_drawn(&wires[at]) && !near_solid(at))
        .count();
    assert_eq!(
        apart, 0,
        "a line lies at most one pixel outside the surface"
    );
}

fn progressive_image_ends_equal_to_its_cpu_twin() {
    let cloud = Arc::new(sphere(450_000));
    let bounds = Bounds::of(cloud.positions.iter().copied()).unwrap();
    let camera = Orbit::framing(&bounds, Vec3::new(0.2, 0.3, 1.0), Vec3::NEG_Y).camera(256, 192);
    let style = SceneStyle {
        edl_strength: 0.0,
        ..by_label()
    };
    let scene = scene(camera, &style);
    let mut view = View::new();
    view.set_model(SceneModel::Cloud(Arc::clone(&cloud)));
    let (gpu, _) = drawn(&mut view, &scene);
    assert_eq!(view.drawn(), (450_000, 450_000));
    let cpu = draw_cloud(&cloud, &camera, &style).image;
    let same = alike(&gpu, &cpu.pixels, 1);
    assert!(same >= 985, "{same} of 1000 pixels agree");
    let background = cpu
        .pixels
        .iter()
        .filter(|&&pixel| pixel == style.background)
        .count();
    assert!(
        background > 2000 && background < 40_000,
        "the sphere fills a part of the image: {background}"
    );
}

/// Draws a model on GPU and CPU and checks what each kind of drawing must keep equal.
fn agrees(model: &SceneModel, camera: &ViewCamera, style: &SceneStyle, what: &str) -> Vec<[u8; 4]> {
    let mut view = View::new();
    view.set_model(model.clone());
    let (gpu, _) = drawn(&mut view, &scene(*camera, style));
    let cpu: Image = match model {
        SceneModel::Cloud(cloud) => draw_cloud(cloud, camera, style).image,
        SceneModel::Surface(mesh) | SceneModel::Wireframe(mesh) => {
            draw_mesh(mesh, camera, style).image
        }
    };
    let same = alike(&gpu, &cpu.pixels, 3);
    assert!(same >= 975, "{what}: {same} of 1000 pixels agree");
    gpu
}

fn different(a: &[[u8; 4]], b: &[[u8; 4]]) -> usize {
    a.iter().zip(b).filter(|(a, b)| a != b).count()
}

fn lighting_clipping_projection_and_opacity_are_equal_on_gpu_and_cpu() {
    let cloud = Arc::new(sphere(60_000));
    let mesh = Arc::new(waves(60).split_at_labels());
    let bounds = Bounds {
        min: Vec3::NEG_ONE,
        max: Vec3::ONE,
    };
    let orbit = Orbit::framing(&bounds, Vec3::new(0.2, 0.3, 1.0), Vec3::NEG_Y);
    let half = Bounds {
        min: Vec3::new(-9.0, -9.0, -9.0),
        max: Vec3::new(0.3, 9.0, 9.0),
    };
    let axes = Axes::new(Vec3::new(0.2, -1.0, 0.1), Vec3::Z);
    for model in [SceneModel::Cloud(cloud), SceneModel::Surface(mesh)] {
        let is_cloud = matches!(model, SceneModel::Cloud(_));
        for orthographic in [false, true] {
            let camera = Orbit {
                orthographic,
                ..orbit
            }
            .camera(256, 192);
            let flat = SceneStyle {
                edl_strength: 0.0,
                ..by_label()
            };
            let plain = agrees(&model, &camera, &flat, "flat");
            let lit = SceneStyle {
                edl_strength: 1.5,
                ..by_label()
            };
            let shaded = agrees(&model, &camera, &lit, "lit");
            assert_eq!(
                different(&plain, &shaded) > 500,
                is_cloud,
                "only points are shaded by depth"
            );
            let clipped = SceneStyle {
                clip: Clip::inside(&axes, &half),
                ..flat.clone()
            };
            assert!(different(&plain, &agrees(&model, &camera, &clipped, "clipped")) > 1000);
            let mut faint = lit.clone();
            (faint.appearance.isolated, faint.appearance.faint) = (Some(LabelId(1)), 0.3);
            assert!(different(&shaded, &agrees(&model, &camera, &faint, "faint")) > 500);
        }
    }
}

fn image_planes_are_oriented_correctly_and_hidden_by_nearer_points() {
    let mut view = View::new();
    let orbit = Orbit::framing(
        &Bounds {
            min: Vec3::splat(-1.0),
            max: Vec3::splat(1.0),
        },
        Vec3::Z,
        Vec3::NEG_Y,
    );
    // Red to the left, blue at the bottom right, behind a grey point in the middle of the left
    // half.
    let pixels = vec![[255, 0, 0], [0, 255, 0], [255, 0, 0], [0, 0, 255]];
    let image = Arc::new(Image {
        width: 2,
        height: 2,
        pixels,
    });
    let corners = [
        [-1.0, -1.0, 0.5],
        [1.0, -1.0, 0.5],
        [1.0, 1.0, 0.5],
        [-1.0, 1.0, 0.5],
    ];
    let point = LabelledCloud::from_positions(vec![Vec3::new(-0.7, 0.0, 0.0)]);
    view.set_model(SceneModel::Cloud(Arc::new(point)));
    let style = SceneStyle {
        point_px: 6.0,
        edl_strength: 0.0,
        ..SceneStyle::default()
    };
    let camera = orbit.camera(256, 256);
    let planes = vec![ImagePlane { corners, image }];
    let (pixels, _) = drawn(
        &mut view,
        &Scene3d {
            planes,
            ..scene(camera, &style)
        },
    );
    let at = |x: Vec3| {
        let (px, _) = camera.project(x).unwrap();
        pixels[px.y as usize * 256 + px.x as usize]
    };
    assert_eq!(at(Vec3::new(-0.8, -0.8, 0.5))[..3], [255, 0, 0]);
    assert_eq!(at(Vec3::new(0.8, -0.8, 0.5))[..3], [0, 255, 0]);
    assert_eq!(at(Vec3::new(0.8, 0.8, 0.5))[..3], [0, 0, 255]);
    assert_eq!(
        at(Vec3::new(-0.7, 0.0, 0.0))[..3],
        [192; 3],
        "the point hides the image"
    );
    let (bare, _) = drawn(&mut view, &scene(camera, &style));
    let (px, _) = camera.project(Vec3::new(0.8, -0.8, 0.5)).unwrap();
    let left = bare[px.y as usize * 256 + px.x as usize];
    assert_eq!(
        left[..3],
        style.background,
        "planes go when they are taken out"
    );
}

fn cleared_view_shows_nothing_of_the_previous_model() {
    let (mut view, style) = (View::new(), by_label());
    view.set_model(SceneModel::Cloud(Arc::new(sphere(2_000))));
    let bounds = Bounds {
        min: Vec3::NEG_ONE,
        max: Vec3::ONE,
    };
    let camera = Orbit::framing(&bounds, Vec3::Z, Vec3::NEG_Y).camera(256, 192);
    drawn(&mut view, &scene(camera, &style));
    view.scene_view.clear();
    assert!(view.scene_view.texture().is_none());

    let (surface, mut fresh) = (Arc::new(waves(12)), View::new());
    view.set_model(SceneModel::Surface(Arc::clone(&surface)));
    fresh.set_model(SceneModel::Surface(surface));
    let [(after, _), (alone, _)] =
        [&mut view, &mut fresh].map(|view| drawn(view, &scene(camera, &style)));
    assert_eq!(different(&after, &alone), 0);
}

crate::tests! {
    cleared_view_shows_nothing_of_the_previous_model,
    surface_equals_its_cpu_twin_and_contains_its_wires,
    progressive_image_ends_equal_to_its_cpu_twin,
    lighting_clipping_projection_and_opacity_are_equal_on_gpu_and_cpu,
    image_planes_are_oriented_correctly_and_hidden_by_nearer_points
}
