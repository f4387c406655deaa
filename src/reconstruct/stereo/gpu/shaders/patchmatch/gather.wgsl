// Choice of the hypotheses that are compared.

fn half_width() -> u32 {
    return (level.size.x + 1u) / 2u;
}

// Returns the hypothesis and cost of a pixel of a colour.
fn field_at(color: u32, column: u32, row: u32) -> vec4f {
    return field[(color * level.size.y + row) * half_width() + column / 2u];
}

fn is_within(column: i32, row: i32) -> bool {
    return column >= 0 && row >= 0 && column < i32(level.size.x) && row < i32(level.size.y);
}

// Returns the offset of a pixel of a region: four V-shaped near ones, four far strips.
fn region_offset(region: u32, place: u32) -> vec2i {
    var offset = vec2i(0, 3 + 2 * i32(place));
    if region < 4u {
        let out = i32((place + 1u) / 2u);
        offset = vec2i(select(-out, out, (place & 1u) == 1u), out + 1);
    }
    switch region & 3u {
        case 0u: { return offset; }
        case 1u: { return offset.yx; }
        case 2u: { return vec2i(offset.x, -offset.y); }
        default: { return vec2i(-offset.y, offset.x); }
    }
}

// Returns the hypothesis of the pixel of least cost in a region, moved to the pixel itself; its `w` is 0 if there is
// none.
fn best_of_region(region: u32) -> vec4f {
    let other = 1u - turn.color;
    let count = select(11u, 7u, region < 4u);
    var best = vec4f(0.0);
    var best_offset = vec2f(0.0);
    var least = NEVER;
    for (var place = 0u; place < count; place++) {
        let offset = region_offset(region, place);
        let column = i32(pixel.x) + offset.x;
        let row = i32(pixel.y) + offset.y;
        if is_within(column, row) {
            let there = field_at(other, u32(column), u32(row));
            if there.w < least {
                least = there.w;
                best = there;
                best_offset = vec2f(offset);
            }
        }
    }
    return vec4f(moved(best.xyz, -best_offset.x, -best_offset.y), select(0.0, 1.0, least < NEVER));
}

struct Gathered {
    planes: array<vec3f, COMPARED>,
    times: array<u32, COMPARED>,
    count: u32,
}

fn gather(own: vec3f, gathered: ptr<function, Gathered>) {
    (*gathered).planes[0] = own;
    (*gathered).times[0] = 1u;
    (*gathered).count = 1u;
    for (var region = 0u; region < 9u; region++) {
        var hypothesis = vec4f(0.0);
        if region < 8u {
            hypothesis = best_of_region(region);
        } else if level.has_guides != 0u && (level.pull <= 0.0 || flatness > 0.0) {
            hypothesis = vec4f(guides[u32(pixel.y) * level.size.x + u32(pixel.x)].xyz, 1.0);
        }
        let plane = hypothesis.xyz;
        if hypothesis.w == 0.0 || !is_possible(plane) {
            continue;
        }
        var known = 0u;
        while known < (*gathered).count {
            let off = abs((*gathered).planes[known] - plane);
            if off.x < level.near_depth && 4.0 * off.y < level.near_depth && 4.0 * off.z < level.near_depth {
                break;
            }
            known++;
        }
        if known < (*gathered).count {
            (*gathered).times[known] += 1u;
        } else {
            (*gathered).planes[known] = plane;
            (*gathered).times[known] = 1u;
            (*gathered).count = known + 1u;
        }
    }
}
