// Rays through the acceleration structure: a tree over instances whose leaves are trees over triangles.
//
// Reads      trace_nodes, trace_triangles, trace_instances (taubench_gl/frame/raytracing/structure.py)
// Counts     trace_overflow: rays that visited more than TRACE_MAX_STEPS nodes and triangles
// Needs      alpha_passes (raytracing/alpha.glsl) where TRACE_ALPHA
// Reference  tests/frame/ray_caster.py
//
// Space: camera-relative, world axes.  An instance takes a ray into the grid of its tree; the direction is not normalized
// there, so t is the same number in every space.
//
// No stack: nodes lie in the order in which they are visited, an inner node names the one to go on with if it is missed
// (Smits 1998).  The result does not depend on that order: of equal distances the lower primitive counts.

#include "raytracing/ray.glsl"

bool alpha_passes(int instance, int triangle, vec2 barycentrics);

ivec2 trace_texel(int i) { return ivec2(i & ((1 << TRACE_ROW_BITS) - 1), i >> TRACE_ROW_BITS); }

// A ray in the grid of one tree.
struct GridRay {
    vec3 origin;
    vec3 direction;
    vec3 inverse; // of the direction, never infinite
};

// The ray in the grid of an instance; ``tree``: first node, nodes, slack, draw.
GridRay enter(Ray ray, int instance, out uvec4 tree) {
    vec4 x = uintBitsToFloat(trace_instances_at(trace_texel(4 * instance)));
    vec4 y = uintBitsToFloat(trace_instances_at(trace_texel(4 * instance + 1)));
    vec4 z = uintBitsToFloat(trace_instances_at(trace_texel(4 * instance + 2)));
    tree = trace_instances_at(trace_texel(4 * instance + 3));
    GridRay r;
    r.origin = vec3(dot(x.xyz, ray.origin) + x.w, dot(y.xyz, ray.origin) + y.w, dot(z.xyz, ray.origin) + z.w);
    r.direction = vec3(dot(x.xyz, ray.direction), dot(y.xyz, ray.direction), dot(z.xyz, ray.direction));
    vec3 d = mix(r.direction, vec3(1e-25), lessThan(abs(r.direction), vec3(1e-25)));
    r.inverse = 1.0 / d;
    return r;
}

// Whether the ray meets a node's box before t_max.  Bounds are 16-bit integers: the low one in the low half.
bool meets_box(GridRay r, uvec4 node, float t_max) {
    ivec3 bits = ivec3(node.xyz);
    vec3 a = (vec3((bits << 16) >> 16) - r.origin) * r.inverse;
    vec3 b = (vec3(bits >> 16) - r.origin) * r.inverse;
    vec3 near = min(a, b), far = max(a, b);
    float enter = max(max(near.x, near.y), max(near.z, 0.0));
    // The factor covers the rounding of both ends (Ize, "Robust BVH Ray Traversal", 2013).
    float leave = min(min(far.x, far.y), min(far.z, t_max)) * 1.0000008;
    return enter <= leave;
}

// Distance and weights of the second and third corner; t < 0: missed, or the origin lies within ``slack`` of the plane
// (FAR_SLACK in texels.py).  The edge functions of two triangles with a common edge have opposite signs bit for bit there, so
// no ray passes between them (Davidovic et al., "3D Rasterization", 2012).
vec3 meet_triangle(GridRay r, vec3 v0, vec3 v1, vec3 v2, float slack) {
    precise vec3 a = v0 - r.origin, b = v1 - r.origin, c = v2 - r.origin;
    precise vec3 bc = vec3(b.y * c.z - b.z * c.y, b.z * c.x - b.x * c.z, b.x * c.y - b.y * c.x);
    precise vec3 ca = vec3(c.y * a.z - c.z * a.y, c.z * a.x - c.x * a.z, c.x * a.y - c.y * a.x);
    precise vec3 ab = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    precise float u = r.direction.x * bc.x + r.direction.y * bc.y + r.direction.z * bc.z;
    precise float v = r.direction.x * ca.x + r.direction.y * ca.y + r.direction.z * ca.z;
    precise float w = r.direction.x * ab.x + r.direction.y * ab.y + r.direction.z * ab.z;
    float low = min(u, min(v, w)), high = max(u, max(v, w));
    vec3 normal = cross(v1 - v0, v2 - v0);
    float along = dot(r.direction, normal);
    float above = dot(a, normal), t = above / along;
    float total = u + v + w;
    bool met = (low >= 0.0 || high <= 0.0) && along != 0.0 && total != 0.0
        && abs(above) >= slack * (abs(normal.x) + abs(normal.y) + abs(normal.z));
    return vec3(met ? t : -1.0, vec2(v, w) / total);
}

#if TRACE_SIGHT
// Rays of sight end at a surface point, at t = 1.  A triangle whose plane holds that point, give or take ``sight_slack``
// (rounding of coordinates, meters; < 0: the ray has no end), does not hide it, however grazing the ray; nor does a side that
// is not drawn.  draw_sides: bits SIDE_* of each draw.
float sight_slack = -1.0;

bool blocks_sight(GridRay r, int instance, vec3 v0, vec3 v1, vec3 v2, int draw) {
    vec3 normal = cross(v1 - v0, v2 - v0);
    uint sides = draw_sides[draw];
    bool front = (dot(r.direction, normal) < 0.0) != ((sides & SIDE_FLIPPED) != 0u);
    if (!front && (sides & SIDE_CULLED) != 0u) return false;
    if (sight_slack < 0.0) return true;
    vec3 x = uintBitsToFloat(trace_instances_at(trace_texel(4 * instance)).xyz);
    vec3 y = uintBitsToFloat(trace_instances_at(trace_texel(4 * instance + 1)).xyz);
    vec3 z = uintBitsToFloat(trace_instances_at(trace_texel(4 * instance + 2)).xyz);
    vec3 relative = abs(normal.x * x + normal.y * y + normal.z * z); // the normal, camera-relative
    float beyond = dot(v0 - (r.origin + r.direction), normal);
    return abs(beyond) > sight_slack * (relative.x + relative.y + relative.z);
}
#endif

// The structure from ``top_instance`` on, a tree over instances.  ``any_hit``: stop at the first triangle met.
//
// Loops are shaped for lanes in lockstep (llvmpipe runs both sides of a branch, and a loop until its last lane is done): first
// walk to the next instance; in its tree walk at most STRETCH nodes towards a leaf, then test one triangle, and again.
Hit trace(Ray ray, const int top_instance, const bool any_hit) {
    const int STRETCH = 8;
    Hit hit = Hit(ray.t_max, -1, -1, vec2(0.0));
    bool finished = true;
    int steps = 0;
    uvec4 top;
    GridRay top_ray = enter(ray, top_instance, top);
    int next_instance = int(top.x), instances_end = int(top.x + top.y);
    while (next_instance < instances_end && finished) {
        int instance = -1;
        while (next_instance < instances_end && instance < 0 && steps < TRACE_MAX_STEPS) {
            uvec4 node = trace_nodes_at(trace_texel(next_instance));
            bool inside = meets_box(top_ray, node, hit.t), leaf = int(node.w) < 0;
            if (inside && leaf) instance = int(node.w & TRACE_LEAF_FIRST);
            next_instance = inside || leaf ? next_instance + 1 : int(top.x + node.w);
            steps++;
        }
        if (instance < 0) break;

        uvec4 tree;
        GridRay r = enter(ray, instance, tree);
        int place = int(tree.x), places_end = int(tree.x + tree.y);
        int slot = 0, slots_end = 0; // triangles of the leaf reached last
#if TRACE_ALPHA
        // A triangle that tests alpha interrupts the walk, so that lanes fetch textures together.  (Not indented further.)
        bool undecided = true;
        while (undecided) {
        undecided = false;
        Hit candidate;
#endif
        while ((slot < slots_end || place < places_end) && steps < TRACE_MAX_STEPS) {
            for (int i = 0; i < STRETCH && slot >= slots_end && place < places_end; i++) {
                uvec4 node = trace_nodes_at(trace_texel(place));
                bool inside = meets_box(r, node, hit.t), leaf = int(node.w) < 0;
                if (inside && leaf) {
                    slot = int(node.w & TRACE_LEAF_FIRST);
                    slots_end = slot + 1 + int((node.w >> TRACE_LEAF_COUNT_SHIFT) & 7u);
                }
                place = inside || leaf ? place + 1 : int(tree.x + node.w);
                steps++;
            }
            if (slot >= slots_end) continue;
            uvec4 t0 = trace_triangles_at(trace_texel(3 * slot));
            uvec4 t1 = trace_triangles_at(trace_texel(3 * slot + 1));
            uvec4 t2 = trace_triangles_at(trace_texel(3 * slot + 2));
            vec3 met = meet_triangle(r, uintBitsToFloat(t0.xyz), uintBitsToFloat(t1.xyz), uintBitsToFloat(t2.xyz),
                uintBitsToFloat(tree.z));
            int draw = int(tree.w + t1.w), triangle = int(t0.w);
            bool lower = draw < hit.instance || (draw == hit.instance && triangle < hit.triangle);
            bool closer = met.x > 0.0 && (met.x < hit.t || (met.x == hit.t && lower));
            Hit found = Hit(met.x, draw, triangle, met.yz);
#if TRACE_SIGHT
            closer = closer && blocks_sight(r, instance, uintBitsToFloat(t0.xyz), uintBitsToFloat(t1.xyz),
                                            uintBitsToFloat(t2.xyz), draw);
#endif
            slot++;
            steps++;
#if TRACE_ALPHA
            if (closer && (t2.w & 1u) != 0u) {
                candidate = found;
                undecided = true;
                break;
            }
#endif
            if (closer) {
                hit = found;
                if (any_hit) break;
            }
        }
#if TRACE_ALPHA
        if (undecided && alpha_passes(candidate.instance, candidate.triangle, candidate.barycentrics)) {
            hit = candidate;
            if (any_hit) break;
        }
        }
#endif
        if (any_hit && hit.instance >= 0) break;
        finished = slot >= slots_end && place >= places_end;
    }
    // Also where the driver ends loops by itself (taubench_gl/frame/tuning.py, LOOP_LIMIT).
    if (!(any_hit && hit.instance >= 0) && !(finished && next_instance >= instances_end)) atomicAdd(trace_overflow[0], 1u);
    return hit;
}

Hit closest_hit(Ray ray) { return trace(ray, 0, false); }

// Whether anything lies in (0, t_max).
bool occluded(Ray ray) { return trace(ray, 0, true).instance >= 0; }

#if TRACE_PREVIOUS
// As closest_hit and occluded, of the surfaces as they were in the frame before.  The ray is relative to the current camera.
Hit closest_hit_before(Ray ray) { return trace(ray, TRACE_PREVIOUS_TOP, false); }
bool occluded_before(Ray ray) { return trace(ray, TRACE_PREVIOUS_TOP, true).instance >= 0; }
#endif

// What the coordinates of a point are rounded to, at most: a share of its distance from the camera and of the extent of the
// merged draws.
float rounding_size(vec3 p) {
    vec3 size = abs(p);
    return max(size.x, max(size.y, size.z)) + uintBitsToFloat(trace_instances_at(trace_texel(3)).w);
}

const float ORIGIN_OFFSET = 1.5e-6; // of rounding_size

// A ray origin near p on the side of its surface to which ``direction`` points.
vec3 offset_origin(vec3 p, vec3 geometric_normal, vec3 direction) {
    float offset = ORIGIN_OFFSET * rounding_size(p);
    return p + (dot(geometric_normal, direction) < 0.0 ? -offset : offset) * geometric_normal;
}
