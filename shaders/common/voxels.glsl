// Visibility through the occupancy grid: 3D-DDA (Amanatides and Woo 1987) between two points of scene space, which
// strides over empty bricks of 4 x 4 x 4 voxels.

uvec4 brick_of(ivec3 cell) { return bricks_at(ivec2(cell.x >> 2, (cell.z >> 2) * (GRID / 4) + (cell.y >> 2))); }

bool has_surface(uvec4 brick, ivec3 cell) {
    uint bit = uint(cell.x & 3 | (cell.y & 3) << 2 | (cell.z & 3) << 4);
    return ((bit < 32u ? brick.x : brick.y) >> (bit & 31u) & 1u) != 0u;
}

bool occupied(ivec3 c) {
    if (any(greaterThanEqual(uvec3(c), uvec3(GRID)))) return false; // negative ones are huge
    return has_surface(brick_of(c), c);
}

// ``slack``: distance at either end, in voxels, within which nothing blocks: the end points lie on surfaces themselves.
bool sees(vec3 from, vec3 to, vec2 slack) {
    vec3 a = (from - P.grid_origin.xyz) / P.grid_origin.w, b = (to - P.grid_origin.xyz) / P.grid_origin.w;
    vec3 d = b - a;
    float span = length(d);
    if (span <= slack.x + slack.y) return true;
    d /= span;
    a += d * slack.x;
    float reach = span - slack.x - slack.y;
    // Mirrored so that the ray climbs along every axis; ``mirror`` is -1 where it is, and maps cells back.
    ivec3 mirror = -ivec3(lessThan(d, vec3(0.0)));
    a = mix(a, float(GRID) - a, lessThan(d, vec3(0.0)));
    d = abs(d);
    vec3 inverse = 1.0 / max(d, vec3(1e-6));
    // There is nothing outside the grid.
    vec3 enter = -a * inverse, leave = (float(GRID) - a) * inverse;
    float t = max(max(enter.x, enter.y), max(enter.z, 0.0));
    reach = min(min(leave.x, leave.y), min(leave.z, reach));
    ivec3 c = clamp(ivec3(floor(a + d * t)), ivec3(0), ivec3(GRID - 1));
    bool free = true;
    for (int i = 0; i < 3 * GRID && t < reach; ++i) {
        ivec3 cell = (c ^ mirror) + (mirror & GRID);
        uvec4 brick = brick_of(cell);
        if (has_surface(brick, cell)) {
            free = false;
            break;
        }
        // Without branches, as lanes go different ways at every mirror: leave the voxel, or the empty bricks around it.
        int stride = int(brick.z);
        ivec3 end = stride > 0 ? ((c >> 2) + stride) << 2 : c + 1;
        vec3 out_at = (vec3(end) - a) * inverse;
        t = min(out_at.x, min(out_at.y, out_at.z));
        c = max(max(c, ivec3(a + d * t)), mix(c, end, lessThanEqual(out_at, vec3(t))));
    }
    return free;
}
