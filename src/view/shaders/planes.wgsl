// Images placed in the scene.

struct Eye {
    clip_from_world: mat4x4<f32>,
    cube_from_world: mat4x4<f32>,
    view: vec4<f32>,
    disc: vec4<f32>,
    place: vec4<f32>,
};

@group(0) @binding(0) var<uniform> eye: Eye;
@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var smooth_sampler: sampler;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) at: vec2<f32>,
};

@vertex
fn vertex(@location(0) position: vec3<f32>, @location(1) at: vec2<f32>) -> Corner {
    var out: Corner;
    out.position = eye.clip_from_world * vec4<f32>(position, 1.0);
    out.at = at;
    return out;
}

@fragment
fn fragment(in: Corner) -> @location(0) vec4<f32> {
    // Opacity 0 excludes the pixel from the model, so that it is not shaded.
    return vec4<f32>(textureSample(picture, smooth_sampler, in.at).rgb, 0.0);
}
