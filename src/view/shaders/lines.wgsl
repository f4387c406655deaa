// Line segments in world space, one pixel wide.

struct Eye {
    clip_from_world: mat4x4<f32>,
    cube_from_world: mat4x4<f32>,
    view: vec4<f32>,
    disc: vec4<f32>,
    place: vec4<f32>,
};

@group(0) @binding(0) var<uniform> eye: Eye;

struct End {
    @builtin(position) position: vec4<f32>,
    @location(0) color: vec4<f32>,
};

@vertex
fn vertex(@location(0) position: vec3<f32>, @location(1) color: vec4<f32>) -> End {
    var out: End;
    out.position = eye.clip_from_world * vec4<f32>(position, 1.0);
    out.color = color;
    return out;
}

@fragment
fn fragment(in: End) -> @location(0) vec4<f32> {
    // Opacity 0 excludes the pixel from the model, so that it is not shaded.
    return vec4<f32>(in.color.rgb, 0.0);
}
