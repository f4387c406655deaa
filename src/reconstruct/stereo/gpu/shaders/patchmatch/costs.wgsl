// Costs.

fn alike(grey: u32) -> f32 {
    return level.alike[grey >> 2u][grey & 3u];
}

// Returns the weight by difference of chroma.
fn alike_chroma(chroma: u32, own: u32) -> f32 {
    let a = absolute(chroma & 0xFFu, own & 0xFFu);
    let b = absolute(chroma >> 8u, own >> 8u);
    return level.alike_chroma[a >> 2u][a & 3u] * level.alike_chroma[b >> 2u][b & 3u];
}

fn absolute(a: u32, b: u32) -> u32 {
    return max(a, b) - min(a, b);
}

// Returns the chroma at an index: the pixels of the image come first, then the texels of the sources.
fn chroma_of(at: u32) -> vec2f {
    return vec2f(f32(chromas[at] & 0xFFu), f32(chromas[at] >> 8u));
}

fn sum_on(before: f32, v: vec4f) -> f32 {
    return (((before + v.x) + v.y) + v.z) + v.w;
}

// Computes the bilateral weights of a patch, and its variance.
fn make_patch() {
    let last = vec2f(level.size) - 1.0;
    let here = u32(pixel.y) * level.size.x + u32(pixel.x);
    let centre = picture[here] & 0xFFu;
    let own = chromas[here];
    patch_chroma = chroma_of(here);
    var values: array<vec4f, QUARTERS>;
    var sum = 0.0;
    var mean = 0.0;
    for (var k = 0u; k < QUARTERS; k++) {
        let column = vec4u(clamp(pixel.x + level.dx[k], vec4f(0.0), vec4f(last.x)));
        let row = vec4u(clamp(pixel.y + level.dy[k], vec4f(0.0), vec4f(last.y)));
        let at = row * level.size.x + column;
        let grey = vec4u(picture[at.x], picture[at.y], picture[at.z], picture[at.w]) & vec4u(0xFFu);
        let off = max(grey, vec4u(centre)) - min(grey, vec4u(centre));
        var weight = level.near[k] * vec4f(alike(off.x), alike(off.y), alike(off.z), alike(off.w));
        for (var i = 0u; i < 4u; i++) {
            weight[i] *= alike_chroma(chromas[at[i]], own);
        }
        values[k] = vec4f(grey);
        weights[k] = weight;
        sum = sum_on(sum, weight);
        mean = sum_on(mean, weight * values[k]);
    }
    let scale = 1.0 / sum;
    mean *= scale;
    variance = 0.0;
    for (var k = 0u; k < QUARTERS; k++) {
        weights[k] *= scale;
        let off = values[k] - mean;
        weighted[k] = weights[k] * off;
        variance = sum_on(variance, weighted[k] * off);
    }
    let c = level.constants;
    color_weight = c.color_weight * c.color_variance * (1.0 / (variance + c.color_variance));
    flatness = 0.0;
    if level.has_guides != 0u && guides[here].w == 2.0 && variance < c.flat_below {
        let share = c.flat_variance * (1.0 / (max(variance - c.noise, 0.0) + c.flat_variance));
        flatness = share * share;
        pulled_to = guides[here].x;
    }
}

// Returns the homogeneous position of the pixel at inverse depth `w` in a source.
fn seen(source: u32, w: f32) -> vec3f {
    let m0 = level.sources[source].matrix[0].xyz;
    let m1 = level.sources[source].matrix[1].xyz;
    let m2 = level.sources[source].matrix[2].xyz;
    return m2 + m0 * pixel.x + m1 * pixel.y + level.sources[source].offset.xyz * w;
}

fn byte(quads: vec4u, place: u32) -> vec4f {
    return vec4f((quads >> vec4u(place)) & vec4u(0xFFu));
}

// Returns bilinear samples of a source at positions within it.
fn sample(source: u32, x: vec4f, y: vec4f) -> vec4f {
    let below_x = round(x - 0.5);
    let below_y = round(y - 0.5);
    let share_x = x - below_x;
    let share_y = y - below_y;
    let at = vec4u(below_y) * level.sources[source].size.x + vec4u(below_x) + level.sources[source].first;
    let quads = vec4u(texels[at.x], texels[at.y], texels[at.z], texels[at.w]);
    let a = byte(quads, 0u);
    let c = byte(quads, 16u);
    // It is never below 0; without `max`, compilers factor `share_x` out of the difference below, and round otherwise.
    let above = max(share_x * (byte(quads, 8u) - a) + a, vec4f(0.0));
    let below = share_x * (byte(quads, 24u) - c) + c;
    return share_y * (below - above) + above;
}

// Returns the difference of chroma of a source at a position within it.
fn chroma_off(source: u32, u: f32, v: f32) -> f32 {
    let size = level.sources[source].size;
    let low = min(vec2u(vec2f(u, v)), size - 1u);
    let high = min(low + 1u, size - 1u);
    let share = vec2f(u, v) - vec2f(low);
    let first = level.size.x * level.size.y + level.sources[source].first;
    let a = chroma_of(first + low.y * size.x + low.x);
    let b = chroma_of(first + low.y * size.x + high.x);
    let c = chroma_of(first + high.y * size.x + low.x);
    let d = chroma_of(first + high.y * size.x + high.x);
    let above = max(share.x * (b - a) + a, vec2f(0.0));
    let below = share.x * (d - c) + c;
    let off = abs(max(share.y * (below - above) + above, vec2f(0.0)) - patch_chroma);
    return off.x + off.y;
}

// Eight parallel sums, as in the processor's vectors.
fn reduced(low: vec4f, high: vec4f) -> f32 {
    let four = low + high;
    let two = four.xy + four.zw;
    return two.x + two.y;
}

// Returns whether there is nothing to compare.
fn is_empty() -> bool {
    return variance < level.min_variance && flatness <= 0.0;
}

// Returns the cost of a hypothesis' difference from the pixel's hint, if its patch is flat.
fn pulled(plane: vec3f) -> f32 {
    let most = flatness * level.pull;
    if most <= 0.0 {
        return 0.0;
    }
    let off = abs(plane.x - pulled_to) * level.per_pull_reach;
    return min(most * off, most);
}

// Returns `1 - NCC`, or flatness for a flat patch, plus the cost of the chroma difference; `worst` if the centre is
// not seen.
fn photometric(source: u32, plane: vec3f) -> f32 {
    let offset = level.sources[source].offset.xyz;
    let at = seen(source, plane.x);
    let right = level.sources[source].matrix[0].xyz + plane.y * offset;
    let down = level.sources[source].matrix[1].xyz + plane.z * offset;
    let last = vec2f(level.sources[source].size - 1u);
    let inside = min(min(min(min(at.x, at.y), last.x * at.z - at.x), last.y * at.z - at.y), at.z - 1e-6);
    if inside < 0.0 {
        return level.constants.worst;
    }
    var means: array<vec4f, 2>;
    var squares: array<vec4f, 2>;
    var crosses: array<vec4f, 2>;
    for (var k = 0u; k < QUARTERS; k++) {
        let dx = level.dx[k];
        let dy = level.dy[k];
        let x = dy * down.x + (dx * right.x + at.x);
        let y = dy * down.y + (dx * right.y + at.y);
        let z = dy * down.z + (dx * right.z + at.z);
        let scale = 1.0 / max(z, vec4f(1e-6));
        let u = min(max(x * scale, vec4f(0.0)), vec4f(last.x));
        let v = min(max(y * scale, vec4f(0.0)), vec4f(last.y));
        let value = sample(source, u, v);
        let heavy = weights[k] * value;
        let side = k & 1u;
        means[side] += heavy;
        squares[side] = heavy * value + squares[side];
        crosses[side] = weighted[k] * value + crosses[side];
    }
    let mean = reduced(means[0], means[1]);
    let square = reduced(squares[0], squares[1]);
    let cross = reduced(crosses[0], crosses[1]);
    let there = max(square - mean * mean, 0.0);
    let scale = 1.0 / at.z;
    let off = chroma_off(source, at.x * scale, at.y * scale);
    let c = level.constants;
    let other = clamp((off - c.same_chroma) * c.per_chroma_range, 0.0, 1.0);
    let color = color_weight * other;
    let unlike = 1.0 + color - cross * (1.0 / sqrt((variance + c.noise) * (there + c.noise)));
    let texture = max(there - c.noise, 0.0);
    let flat_cost = c.flat_cost + color + c.unlike_cost * (texture * (1.0 / (texture + c.flat_variance)));
    return min(min(unlike, flat_cost + (1.0 - flatness) * c.worst), c.worst);
}

// Returns the distance in pixels between the pixel and its projection to the source and back, by the source's own
// depth.
fn forward_backward(source: u32, plane: vec3f) -> f32 {
    let there = seen(source, plane.x);
    let forth = 1.0 / there.z;
    let u = there.x * forth;
    let v = there.y * forth;
    let column = u32(max(u + 0.5, 0.0));
    let row = u32(max(v + 0.5, 0.0));
    let size = level.sources[source].size;
    if column >= size.x || row >= size.y {
        return NEVER;
    }
    let at = level.sources[source].first + row * size.x + column;
    let found = vec3f(found_depth[at], found_right[at], found_down[at]);
    if found.x <= 0.0 {
        return NEVER;
    }
    let w = moved(found, u - f32(column), v - f32(row)).x;
    let b0 = level.sources[source].back[0].xyz;
    let b1 = level.sources[source].back[1].xyz;
    let b2 = level.sources[source].back[2].xyz;
    let back = b2 + b0 * u + b1 * v + level.sources[source].back_offset.xyz * w;
    let scale = 1.0 / back.z;
    let s = back.x * scale - pixel.x;
    let t = back.y * scale - pixel.y;
    return sqrt(s * s + t * t);
}

fn cost_in(source: u32, plane: vec3f) -> f32 {
    let cost = photometric(source, plane);
    if cost < level.constants.worst && level.sources[source].has_found != 0u {
        return cost + level.geometric_weight * min(forward_backward(source, plane), level.max_geometric_px);
    }
    return cost;
}
