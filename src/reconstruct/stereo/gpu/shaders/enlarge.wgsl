// Copies the hypotheses of a coarser field to the four pixels of each of its pixels; costs are not known yet.

struct Sizes {
    fine: vec2u,
    coarse: vec2u,
    // Cost of a plane that was not compared.
    worst: f32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
// Red pixels, then black ones: inverse depth, its change per pixel to the right and down, cost.
@group(0) @binding(1) var<storage, read> coarse: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> fine: array<vec4f>;

fn place(at: vec2u, size: vec2u) -> u32 {
    let color = (at.x + at.y) & 1u;
    return (color * size.y + at.y) * ((size.x + 1u) / 2u) + at.x / 2u;
}

@compute @workgroup_size(8, 8)
fn enlarge(@builtin(global_invocation_id) id: vec3u) {
    let at = id.xy;
    if at.x >= sizes.fine.x || at.y >= sizes.fine.y {
        return;
    }
    let parent = min(at / 2u, sizes.coarse - 1u);
    let plane = coarse[place(parent, sizes.coarse)].xyz;
    let off = 0.5 * (vec2f(at) - 0.5) - vec2f(parent);
    let inverse_depth = plane.x + plane.y * off.x + plane.z * off.y;
    fine[place(at, sizes.fine)] = vec4f(inverse_depth, 0.5 * plane.yz, sizes.worst);
}
