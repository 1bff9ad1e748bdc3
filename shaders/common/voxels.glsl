// Visibility through the occupancy grid: 3D-DDA (Amanatides and Woo 1987) between two points of scene space.
uniform usampler2D voxels; // bits along x, 32 a texel; a row of texels for every y, then z

bool occupied(ivec3 c) {
    if (any(greaterThanEqual(uvec3(c), uvec3(GRID)))) return false; // negative ones are huge
    return (texelFetch(voxels, ivec2(c.x >> 5, c.z * GRID + c.y), 0).r >> uint(c.x & 31) & 1u) != 0u;
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
    bool free = true;
    for (int i = 0; i < 3 * GRID && t < reach; ++i) {
        if (occupied(c)) {
            free = false;
            break;
        }
        // Without branches: lanes go different ways here at every turn.
        bool along_x = next.x <= next.y && next.x <= next.z, along_y = !along_x && next.y <= next.z;
        bvec3 along = bvec3(along_x, along_y, !(along_x || along_y));
        t = along_x ? next.x : along_y ? next.y : next.z;
        next += mix(vec3(0.0), inverse, along);
        c += mix(ivec3(0), step, along);
    }
    return free;
}
