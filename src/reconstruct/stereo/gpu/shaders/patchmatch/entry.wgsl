// Entry points.

// Returns the index of a thread's pixel in the field, or -1 if there is nothing to do; sets the pixel and its patch.
fn begin(id: vec3u) -> i32 {
    let row = turn.first_row + id.y;
    let column = 2u * id.x + ((row + turn.color) & 1u);
    if row >= turn.end_row || column >= level.size.x {
        return -1;
    }
    if level.has_guides != 0u && guides[row * level.size.x + column].w == 0.0 {
        return -1;
    }
    pixel = vec2f(f32(column), f32(row));
    make_patch();
    return i32((turn.color * level.size.y + row) * half_width() + id.x);
}

// Computes the cost of a pixel's own hypothesis over its two best sources.
@compute @workgroup_size(8, 8)
fn score(@builtin(global_invocation_id) id: vec3u) {
    let place = begin(id);
    if place < 0 {
        return;
    }
    let plane = field[place].xyz;
    var least = vec2f(level.constants.worst);
    for (var source = 0u; source < level.source_count && !is_empty(); source++) {
        let cost = cost_in(source, plane);
        if cost < least.y {
            least = vec2f(min(least.x, cost), max(least.x, cost));
        }
    }
    let seen = select(least.x, 0.5 * (least.x + least.y), level.source_count > 1u);
    field[place] = vec4f(plane, min(seen + pulled(plane), level.constants.worst));
}

// Finds the best hypothesis for a pixel: its own, those of the other colour around it, and changed ones.
@compute @workgroup_size(8, 8)
fn sweep(@builtin(global_invocation_id) id: vec3u) {
    let place = begin(id);
    if place < 0 {
        return;
    }
    let own = field[place].xyz;
    if is_empty() {
        field[place] = vec4f(own, level.constants.worst);
        return;
    }
    var gathered: Gathered;
    gather(own, &gathered);
    var costs: array<f32, MAX_SOURCES * COMPARED>;
    for (var k = 0u; k < gathered.count; k++) {
        for (var source = 0u; source < level.source_count; source++) {
            costs[k * MAX_SOURCES + source] = cost_in(source, gathered.planes[k]);
        }
    }
    var views: Views;
    choose_views(&gathered, &costs, &views);
    var best = vec4f(own, NEVER);
    for (var k = 0u; k < gathered.count && views.count > 0u; k++) {
        var cost = pulled(gathered.planes[k]);
        for (var source = 0u; source < level.source_count; source++) {
            cost += views.weights[source] * costs[k * MAX_SOURCES + source];
        }
        if cost < best.w {
            best = vec4f(gathered.planes[k], cost);
        }
    }
    field[place] = contest(best, &views);
}
