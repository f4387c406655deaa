// Triangles or their edges; both sides are lit from the camera. CPU twin: mesh_raster.rs.

struct Eye {
    clip_from_world: mat4x4<f32>,
    // Maps the inside of the clip box to the cube from -1 to 1.
    cube_from_world: mat4x4<f32>,
    view: vec4<f32>,
    disc: vec4<f32>,
    // xyz: camera position; w: brightness of a surface that is seen edge-on.
    place: vec4<f32>,
};

@group(0) @binding(0) var<uniform> eye: Eye;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(linear) color: vec4<f32>,
    @location(1) @interpolate(linear) light: f32,
    @location(2) in_cube: vec3<f32>,
};

@vertex
fn vertex(
    @location(0) position: vec3<f32>,
    @location(1) color: vec4<f32>,
    @location(2) normal: vec4<f32>,
) -> Corner {
    var out: Corner;
    out.position = eye.clip_from_world * vec4<f32>(position, 1.0);
    out.color = color;
    let towards = eye.place.xyz - position;
    let facing = abs(dot(towards / max(length(towards), 1e-20), normal.xyz));
    out.light = eye.place.w + (1.0 - eye.place.w) * facing;
    out.in_cube = (eye.cube_from_world * vec4<f32>(position, 1.0)).xyz;
    return out;
}

// An ordered dither (Bayer 1973): faint triangles need no drawing order.
fn is_shown(opacity: f32, at: vec2<u32>) -> bool {
    var thresholds = array<f32, 16>(0., 8., 2., 10., 12., 4., 14., 6., 3., 11., 1., 9., 15., 7., 13., 5.);
    return opacity * 16.0 > thresholds[(at.y % 4u) * 4u + at.x % 4u] + 0.5;
}

@fragment
fn fragment(in: Corner) -> @location(0) vec4<f32> {
    let off = abs(in.in_cube);
    if max(off.x, max(off.y, off.z)) > 1.0 || !is_shown(in.color.a, vec2<u32>(in.position.xy)) {
        discard;
    }
    return vec4<f32>(in.color.rgb * in.light, in.color.a);
}
