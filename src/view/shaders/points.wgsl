// Points as round discs of uniform colour. CPU twin: raster.rs.

struct Eye {
    clip_from_world: mat4x4<f32>,
    // Maps the inside of the clip box to the cube from -1 to 1.
    cube_from_world: mat4x4<f32>,
    // x, y: size of the image in pixels; z: pixels per world unit at clip w = 1.
    view: vec4<f32>,
    // x: minimum, y: maximum disc radius in pixels.
    disc: vec4<f32>,
    place: vec4<f32>,
};

@group(0) @binding(0) var<uniform> eye: Eye;
// x: factor by which discs grow where not all points are drawn.
@group(1) @binding(0) var<uniform> growth: vec4<f32>;

struct Disc {
    @builtin(position) position: vec4<f32>,
    @location(0) color: vec4<f32>,
    @location(1) corner: vec2<f32>,
};

@vertex
fn vertex(
    @builtin(vertex_index) index: u32,
    @location(0) position: vec3<f32>,
    @location(1) color: vec4<f32>,
    @location(2) radius: f32,
) -> Disc {
    var out: Disc;
    let corner = vec2<f32>(f32(index & 1u) * 2.0 - 1.0, f32(index >> 1u) * 2.0 - 1.0);
    let at = eye.clip_from_world * vec4<f32>(position, 1.0);
    let radius_px = clamp(radius * growth.x * eye.view.z / max(at.w, 1e-9), eye.disc.x, eye.disc.y);
    out.position = at + vec4<f32>(corner * radius_px * 2.0 / eye.view.xy * at.w, 0.0, 0.0);
    let in_cube = abs((eye.cube_from_world * vec4<f32>(position, 1.0)).xyz);
    if color.a == 0.0 || max(in_cube.x, max(in_cube.y, in_cube.z)) > 1.0 {
        // Hidden: outside the clip volume.
        out.position = vec4<f32>(2.0, 2.0, 2.0, 1.0);
    }
    out.color = color;
    out.corner = corner;
    return out;
}

// An ordered dither (Bayer 1973): faint points need no drawing order.
fn is_shown(opacity: f32, at: vec2<u32>) -> bool {
    var thresholds = array<f32, 16>(0., 8., 2., 10., 12., 4., 14., 6., 3., 11., 1., 9., 15., 7., 13., 5.);
    return opacity * 16.0 > thresholds[(at.y % 4u) * 4u + at.x % 4u] + 0.5;
}

@fragment
fn fragment(in: Disc) -> @location(0) vec4<f32> {
    if dot(in.corner, in.corner) > 1.0 || !is_shown(in.color.a, vec2<u32>(in.position.xy)) {
        discard;
    }
    return in.color;
}
