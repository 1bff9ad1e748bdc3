// Visibility through the occupancy grid: 3D-DDA (Amanatides and Woo 1987) between two points of scene space.
layout(std430, binding = 4) readonly buffer Voxels { uint voxels[]; };

bool occupied(ivec3 c) {
    if (any(lessThan(c, ivec3(0))) || any(greaterThanEqual(c, ivec3(GRID)))) return false;
    uint index = uint((c.z * GRID + c.y) * GRID + c.x);
    return (voxels[index >> 5] >> (index & 31u) & 1u) != 0u;
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
    ivec3 c = ivec3(floor(a));
    ivec3 step = ivec3(sign(d));
    vec3 inverse = 1.0 / max(abs(d), vec3(1e-6));
    vec3 next = (mix(fract(a), 1.0 - fract(a), greaterThan(d, vec3(0.0)))) * inverse;
    float t = 0.0;
    for (int i = 0; i < 3 * GRID && t < reach; ++i) {
        if (occupied(c)) return false;
        if (next.x <= next.y && next.x <= next.z) { t = next.x; next.x += inverse.x; c.x += step.x; }
        else if (next.y <= next.z) { t = next.y; next.y += inverse.y; c.y += step.y; }
        else { t = next.z; next.z += inverse.z; c.z += step.z; }
    }
    return true;
}
