// Triangles (or their sides), lit from the camera from both sides. Twin: mesh_raster.rs.

struct Eye {
    clip_from_world: mat4x4<f32>,
    view: vec4<f32>,
    disc: vec4<f32>,
    // xyz: where the camera is; w: light on a surface that is seen along itself.
    place: vec4<f32>,
};

@group(0) @binding(0) var<uniform> eye: Eye;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(linear) color: vec3<f32>,
    @location(1) @interpolate(linear) light: f32,
};

@vertex
fn vertex(
    @location(0) position: vec3<f32>,
    @location(1) color: vec4<f32>,
    @location(2) normal: vec4<f32>,
) -> Corner {
    var out: Corner;
    out.position = eye.clip_from_world * vec4<f32>(position, 1.0);
    out.color = color.rgb;
    let towards = eye.place.xyz - position;
    let facing = abs(dot(towards / max(length(towards), 1e-20), normal.xyz));
    out.light = eye.place.w + (1.0 - eye.place.w) * facing;
    return out;
}

@fragment
fn fragment(in: Corner) -> @location(0) vec4<f32> {
    return vec4<f32>(in.color * in.light, 1.0);
}
