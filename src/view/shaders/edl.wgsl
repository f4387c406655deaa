// Eye-dome lighting (Boucheny 2009): darkens a pixel by how much farther it is than its neighbours.
// CPU twin: raster.rs.

struct Dome {
    // 0 means off.
    strength: f32,
    // Orthographic views: extent of the depth buffer in multiples of the target's depth.
    // 0 in perspective.
    span: f32,
};

// Opacity 0 means that the model is not drawn there.
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var<uniform> dome: Dome;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    // One triangle that covers the image.
    return vec4<f32>(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// Depths are reversed: larger is nearer.
fn farther(own: f32, other: f32) -> f32 {
    if dome.span > 0.0 {
        return (other - own) * dome.span;
    }
    return log(other / own);
}

@fragment
fn fragment(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = vec2<i32>(position.xy);
    let own = textureLoad(picture, at, 0);
    if dome.strength <= 0.0 || own.a == 0.0 {
        return vec4<f32>(own.rgb, 1.0);
    }
    let size = vec2<i32>(textureDimensions(picture));
    let depth = textureLoad(depths, at, 0);
    var drop = 0.0;
    for (var dy = -2; dy <= 2; dy += 2) {
        for (var dx = -2; dx <= 2; dx += 2) {
            let beside = at + vec2<i32>(dx, dy);
            if (dx == 0 && dy == 0) || any(beside < vec2<i32>(0)) || any(beside >= size) {
                continue;
            }
            if textureLoad(picture, beside, 0).a >= own.a {
                drop += max(farther(depth, textureLoad(depths, beside, 0)) * 100.0, 0.0);
            }
        }
    }
    let light = clamp(exp(-drop * dome.strength / 8.0), 0.25, 1.0);
    return vec4<f32>(own.rgb * light, 1.0);
}
