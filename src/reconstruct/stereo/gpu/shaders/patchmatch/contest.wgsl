// Changes of hypotheses.

fn changed(plane: vec3f, dice: ptr<function, Dice>, depth: f32, slope: f32) -> vec3f {
    var other = plane;
    other.x += depth * signed(dice);
    other.y += slope * signed(dice) * other.x * level.per_focal.x;
    other.z += slope * signed(dice) * other.x * level.per_focal.y;
    return other;
}

// Returns the hypothesis of a pixel of the other colour at about an offset; its `w` is 0 outside the image.
fn far_off(dice: ptr<function, Dice>) -> vec4f {
    var dx = i32(level.constants.far * signed(dice));
    let dy = i32(level.constants.far * signed(dice));
    dx += select(0, 1, ((dx + dy) & 1) == 0);
    let column = i32(pixel.x) + dx;
    let row = i32(pixel.y) + dy;
    if !is_within(column, row) {
        return vec4f(0.0);
    }
    let there = field_at(1u - turn.color, u32(column), u32(row)).xyz;
    return vec4f(moved(there, -f32(dx), -f32(dy)), 1.0);
}

// Steps to the vertex of the parabola through three costs.
fn vertex(before: f32, middle: f32, after: f32) -> f32 {
    let bend = before + after - 2.0 * middle;
    if bend > 1e-6 && bend < 0.1 * NEVER {
        return clamp(0.5 * (before - after) * (1.0 / bend), -2.0, 2.0);
    }
    return select(1.0, -1.0, before < after);
}

// Returns a plane moved by steps along the inverse depth, or along the slope that this visit changes.
fn stepped(plane: vec3f, along_slope: bool, steps: f32) -> vec3f {
    if !along_slope {
        return vec3f(plane.x + steps * turn.by_depth, plane.yz);
    }
    if (turn.visit & 1u) == 0u {
        return vec3f(plane.x, plane.y + steps * turn.by_slope, plane.z);
    }
    return vec3f(plane.xy, plane.z + steps * turn.by_slope);
}

// Tries samples of the whole range and of distant pixels, random changes, then two parabolas. All go through one
// comparison, one after the other, which keeps the program short. `best` holds the hypothesis and its cost.
fn contest(start: vec4f, views: ptr<function, Views>) -> vec4f {
    var best = start;
    let place = u32(pixel.y) * level.size.x + u32(pixel.x);
    var dice = Dice(hash(level.seed ^ hash(turn.visit ^ hash(place))), 0u);
    var beside = Dice(hash(dice.key), 0u);
    let drawn = max(turn.draws, select(0u, 1u, best.w > 0.5));
    let far = drawn + turn.draws;
    var before = 0.0;
    var after = 0.0;
    for (var round = 0u; round < far + 9u; round++) {
        var plane = best.xyz;
        var limit = best.w;
        let change = round - far;
        let phase = change % 3u;
        let is_step = round >= far + 3u;
        if round < drawn {
            plane = vec3f(level.range.x + (level.range.y - level.range.x) * unit(&beside), 0.0, 0.0);
        } else if round < far {
            let there = far_off(&beside);
            if there.w == 0.0 {
                continue;
            }
            plane = there.xyz;
        } else if is_step {
            var steps = select(-1.0, 1.0, phase == 1u);
            if phase == 2u {
                steps = vertex(before, best.w, after);
            } else {
                limit = NEVER;
            }
            plane = stepped(plane, change >= 6u, steps);
        } else {
            let depth = array<f32, 3>(turn.depth, 0.0, 0.5 * turn.depth);
            let slope = array<f32, 3>(0.0, turn.slope, 0.5 * turn.slope);
            plane = changed(plane, &dice, depth[phase], slope[phase]);
        }
        let cost = cost_of(plane, views, limit);
        if is_step && phase == 0u {
            before = cost;
        } else if is_step && phase == 1u {
            after = cost;
        } else if cost < best.w {
            best = vec4f(plane, cost);
        }
    }
    return best;
}
