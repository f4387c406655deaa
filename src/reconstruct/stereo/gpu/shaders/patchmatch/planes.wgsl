// Planes.

fn moved(plane: vec3f, dx: f32, dy: f32) -> vec3f {
    return vec3f(plane.x + plane.y * dx + plane.z * dy, plane.yz);
}

fn is_possible(plane: vec3f) -> bool {
    let off = level.principal - pixel;
    let at_axis = plane.x + plane.y * off.x + plane.z * off.y;
    let normal = vec3f(plane.y * level.focal.x, plane.z * level.focal.y, at_axis);
    let ray = (pixel - level.principal) * level.per_focal;
    let normal_squared = normal.x * normal.x + normal.y * normal.y + normal.z * normal.z;
    let ray_squared = 1.0 + ray.x * ray.x + ray.y * ray.y;
    let length = sqrt(normal_squared * ray_squared);
    return plane.x >= level.range.x && plane.x <= level.range.y && plane.x >= level.min_facing * length;
}
