// Choice of the sources that count.

struct Views {
    weights: array<f32, MAX_SOURCES>,
    order: array<u32, MAX_SOURCES>,
    count: u32,
}

fn likelihood(cost: f32) -> f32 {
    let x = cost * (1.0 / 0.18) * cost;
    let y = 1.0 + x * (0.25 + x * 0.03125);
    return 1.0 / (y * y * y * y);
}

// Weight of a source, and the lowest cost of any hypothesis in it.
fn judged(source: u32, gathered: ptr<function, Gathered>, costs: ptr<function, array<f32, MAX_SOURCES * COMPARED>>) -> vec2f {
    var goods = 0u;
    var bads = 0u;
    var total = 0u;
    var sum = 0.0;
    var least = NEVER;
    for (var k = 0u; k < (*gathered).count; k++) {
        let cost = (*costs)[k * MAX_SOURCES + source];
        let times = (*gathered).times[k];
        total += times;
        if cost < turn.good {
            goods += times;
            sum += f32(times) * likelihood(cost);
        }
        bads += select(0u, times, cost > level.constants.bad);
        least = min(least, cost);
    }
    if 4u * goods > total && 3u * bads < total {
        return vec2f(sum * (1.0 / f32(goods)), least);
    }
    return vec2f(0.0, least);
}

fn choose_views(gathered: ptr<function, Gathered>, costs: ptr<function, array<f32, MAX_SOURCES * COMPARED>>, views: ptr<function, Views>) {
    var least: array<f32, MAX_SOURCES>;
    var any = false;
    for (var source = 0u; source < level.source_count; source++) {
        let judgement = judged(source, gathered, costs);
        (*views).weights[source] = judgement.x;
        least[source] = judgement.y;
        any = any || judgement.x > 0.0;
    }
    for (var nearest = 0u; nearest < min(2u, level.source_count) && !any; nearest++) {
        var best = 0u;
        for (var source = 1u; source < level.source_count; source++) {
            best = select(best, source, least[source] < least[best]);
        }
        (*views).weights[best] = 1.0;
        least[best] = NEVER;
    }
    rank(views);
}

// Keeps the heaviest sources.
fn rank(views: ptr<function, Views>) {
    var left = (*views).weights;
    var sum = 0.0;
    (*views).count = 0u;
    for (var k = 0u; k < min(level.best_views, level.source_count); k++) {
        var best = 0u;
        for (var source = 1u; source < level.source_count; source++) {
            best = select(best, source, left[source] > left[best]);
        }
        if left[best] <= 0.0 {
            break;
        }
        sum += left[best];
        (*views).order[k] = best;
        (*views).count = k + 1u;
        left[best] = 0.0;
    }
    for (var source = 0u; source < level.source_count; source++) {
        (*views).weights[source] = select((*views).weights[source] * (1.0 / sum), 0.0, left[source] > 0.0);
    }
}

// Returns the cost over the views that count, or the sum so far if that reaches a limit.
fn cost_of(plane: vec3f, views: ptr<function, Views>, limit: f32) -> f32 {
    if !is_possible(plane) {
        return NEVER;
    }
    var sum = pulled(plane);
    for (var k = 0u; k < (*views).count; k++) {
        let source = (*views).order[k];
        sum += (*views).weights[source] * cost_in(source, plane);
        if sum >= limit {
            break;
        }
    }
    return sum;
}
