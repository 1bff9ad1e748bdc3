// Reprojection (Eq. 3) and feature masks (f_B, section 3.2) of one frame pair, with their counts.
//
// Paper      Eq. (3); section 3.2, f_B.
// Reads      current and history channels: position (xyz relative to its own camera, w = planar depth, 0 = sky), normal,
//            and, where enabled, prev_position, ids and the channels of the other features; with VECTORS the motion that
//            files store (pixels, +y up; not finite: none).
// Writes     mask (reason bits), motion (previous - current, pixels, +y up), distances (position, normal, direct,
//            indirect) and changes (color, depth, luminance), 0 where nothing is compared.
// Counts     mask_histogram[mask]: pixels per mask of COUNTED_BITS reason bits, of which every count is a sum; a histogram of each
//            feature's distance; with BOTH, other_histogram: pixels per mask of the other reprojection less mask_histogram.
// Reference  metrics.masks.pair_masks
// Departs    Eq. (3) has a guard of GUARD_PX, and the near test one of NEAR_GUARD: a still pixel lies exactly on the
//            boundary.  The position is interpolated and then projected, which equals interpolating the previous clip
//            position (the map is linear) and never divides before w is tested.
#include "common/histogram.glsl"
#include "common/motion.glsl"
#include "common/numbers.glsl"
#include "common/tuning.glsl"

struct Sample { // one pixel of channels, or a blend of history pixels
    vec4 position;
    vec3 normal;
    vec3 values[VALUES + 1]; // of the features in EACH_VALUE
};

bool is_surface(vec4 p) { return p.w > 0.0; }

Sample fetch_current(ivec2 at) {
    Sample s;
    s.position = position_at(at);
    s.normal = normal_at(at).xyz;
#define VALUE(I, NOW, BEFORE, DISTANCE, LIMIT, BIT, FEATURE, PLACE) s.values[I] = NOW;
    EACH_VALUE
#undef VALUE
    return s;
}

Sample fetch_history(ivec2 at) {
    Sample s;
    s.position = history_position_at(at);
    s.normal = history_normal_at(at).xyz;
#define VALUE(I, NOW, BEFORE, DISTANCE, LIMIT, BIT, FEATURE, PLACE) s.values[I] = BEFORE;
    EACH_VALUE
#undef VALUE
    return s;
}

bool non_finite(Sample s) {
    bool bad = non_finite(s.position) || non_finite(s.normal);
    for (int i = 0; i < VALUES; ++i) bad = bad || non_finite(s.values[i]);
    return bad;
}

#if BILINEAR
// Blend of the taps that are finite and of the same kind (surface or sky) as the current pixel.  If none is of that
// kind, the nearest finite tap stands for the history; if none is finite, the result is not finite either.
Sample sample_history(vec2 at, bool surface) {
    vec2 base = floor(at);
    vec2 f = at - base;
    Sample nearest;
    float nearest_weight = -1.0, total = 0.0;
    Sample sum;
    sum.position = vec4(0.0);
    sum.normal = vec3(0.0);
    for (int i = 0; i < VALUES; ++i) sum.values[i] = vec3(0.0);
    for (int tap = 0; tap < 4; ++tap) {
        ivec2 offset = ivec2(tap & 1, tap >> 1);
        ivec2 texel = ivec2(base) + offset;
        float weight = (offset.x == 1 ? f.x : 1.0 - f.x) * (offset.y == 1 ? f.y : 1.0 - f.y);
        if (weight <= 0.0 || any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, P.size.xy))) continue;
        Sample s = fetch_history(texel);
        if (weight == 1.0) return s; // an unmoved pixel sees its own history, bit for bit
        bool bad = non_finite(s);
        if (weight > nearest_weight && (!bad || nearest_weight < 0.0)) {
            nearest = s;
            if (!bad) nearest_weight = weight;
        }
        if (bad || is_surface(s.position) != surface) continue;
        total += weight;
        sum.position += weight * s.position;
        sum.normal += weight * s.normal;
        for (int i = 0; i < VALUES; ++i) sum.values[i] += weight * s.values[i];
    }
    if (total <= 0.0) return nearest;
    sum.position /= total;
    sum.normal /= total;
    for (int i = 0; i < VALUES; ++i) sum.values[i] /= total;
    // A blend of unit normals is shorter than 1; the feature is the direction.
    float norm = length(sum.normal);
    if (norm > 0.0) sum.normal /= norm;
    return sum;
}

bool taps_differ(vec2 at, vec2 other) { return at != other; }
#else
ivec2 tap_of(vec2 at) { return clamp(ivec2(floor(at + 0.5)), ivec2(0), P.size.xy - 1); }

Sample sample_history(vec2 at, bool surface) { return fetch_history(tap_of(at)); }

bool taps_differ(vec2 at, vec2 other) { return tap_of(at) != tap_of(other); }
#endif

#if BOTH
bool counts_distances = true;
#else
const bool counts_distances = true;
#endif

void count_distance(int feature, float distance) {
    uint bin = histogram_bin(distance);
    // Bin 0 is the rest of the comparable pixels, so still pixels cost no atomic.
    if (counts_distances && bin > 0u) atomicAdd(histograms[feature * HISTOGRAM_BINS + int(bin)], 1u);
}

#if WRITE_DISTANCES
vec4 pixel_distances = vec4(0.0); // position, normal, direct, indirect, as compared with the thresholds
vec4 pixel_changes = vec4(0.0); // x: distance of color, y: depth behind the history surface (inf: no surface in one of
                                // the frames), z: change of direct luminance
#endif

float distance_direct(vec3 now, vec3 before) { return length((now - before) * P.exposure); }
float distance_indirect(vec3 now, vec3 before) { return distance(now, before) * P.exposure; }
float distance_color(vec3 now, vec3 before) {
    vec3 d = abs(now - before);
    return max(d.x, max(d.y, d.z));
}

// POSITION, and DISOCCLUDED or OCCLUDING, of a surface point that was at q and whose history shows the surface at ``before``.
uint position_bits(vec3 q, vec3 before, out float moved, out float nearer) {
    moved = distance(q, before);
    nearer = length(q) - length(before);
    if (moved <= P.threshold_position) return 0u;
    if (nearer > P.threshold_position) return POSITION | DISOCCLUDED;
    return -nearer > P.threshold_position ? POSITION | OCCLUDING : POSITION;
}

// f_B for every feature.  q: where this surface point was, relative to the previous camera.
uint compare(Sample now, vec3 q, Sample before) {
    uint mask = 0u;
    bool surface = is_surface(now.position), history_surface = is_surface(before.position);
    float inf = uintBitsToFloat(0x7f800000u);
    if (!history_surface) mask |= HISTORY_SKY;
    float moved = 0.0, turned = 0.0; // 0 where neither has a surface: bin 0, which is not counted
    if (surface != history_surface) {
        mask |= POSITION | NORMAL | (surface ? OCCLUDING : DISOCCLUDED);
        moved = turned = inf;
#if WRITE_DISTANCES
        pixel_changes.y = surface ? -inf : inf;
#endif
    } else if (surface) {
        float nearer;
        mask |= position_bits(q, before.position.xyz, moved, nearer);
        turned = distance(now.normal, before.normal);
        if (turned > P.threshold_normal) mask |= NORMAL;
#if WRITE_DISTANCES
        pixel_changes.y = nearer;
#endif
    }
    count_distance(FEATURE_POSITION, moved); // outside the branches: one atomic for both
    count_distance(FEATURE_NORMAL, turned);
#if WRITE_DISTANCES
    pixel_distances.xy = vec2(moved, turned);
#endif
#if WRITE_DISTANCES
#define KEEP(PLACE, DISTANCE) PLACE = DISTANCE
#else
#define KEEP(PLACE, DISTANCE)
#endif
#define VALUE(I, NOW, BEFORE, DISTANCE, LIMIT, BIT, FEATURE, PLACE) { \
        float d = DISTANCE(now.values[I], before.values[I]); \
        if (d > LIMIT) mask |= BIT; \
        count_distance(FEATURE, d); \
        KEEP(PLACE, d); \
    }
    EACH_VALUE
#undef VALUE
#if HAS_DIRECT
    float luminance = dot((now.values[VALUE_DIRECT] - before.values[VALUE_DIRECT]) * P.exposure, vec3(0.2126, 0.7152, 0.0722));
    if ((mask & DIRECT) != 0u) mask |= luminance > 0.0 ? LIT : luminance < 0.0 ? SHADOWED : 0u;
#if WRITE_DISTANCES
    pixel_changes.z = luminance;
#endif
#endif
    return mask;
}

// Where a pixel was: q, relative to the previous camera, and motion in pixels (0 where it is not defined).  ``follow``: motion
// reprojection, else camera.  Bits of a pixel that is not comparable, else 0.
uint reproject(ivec2 pixel, vec4 position, bool follow, out vec3 previous, out vec2 motion) {
    motion = vec2(0.0);
    previous = vec3(0.0);
    bool surface = is_surface(position);
    vec4 p, q; // now, relative to the current camera; then, relative to the previous one
    if (surface) {
        p = vec4(position.xyz, 1.0);
        q = vec4(position.xyz + P.camera_delta.xyz, 1.0);
#if MOTION || BOTH
        if (follow) q = vec4(prev_position_at(pixel).xyz, 1.0);
        if (non_finite(q)) return INVALID;
#endif
    } else { // the view ray itself: w = 0, or a point of the far plane for a parallel projection
        p = P.sky_origin + float(pixel.x) * P.sky_dx + float(pixel.y) * P.sky_dy;
        q = vec4(p.xyz + P.sky_origin.w * P.camera_delta.xyz, p.w);
    }
    previous = q.xyz;
    // Decided before any division.
    float prev_depth = dot(P.prev_forward.xyz, q.xyz);
    // Rounding may place a pixel in front of its near plane; it may have been as far in front of the previous one.
    float limit = surface ? P.prev_near - max(P.near - position.w, 0.0) : 0.0;
    if (prev_depth <= limit) return BEHIND;
    motion = motion_in_pixels(P.prev_clip_from_prev, q, P.clip_from_current, p, P.size.xy);
#if VECTORS // decide where history is sampled; q remains what positions are compared with
    vec2 stored = vectors_at(pixel).xy;
    if (follow && (surface || !non_finite(stored))) motion = stored;
#endif
    vec2 at = vec2(pixel) + motion;
    if (non_finite(motion)) { motion = vec2(0.0); return INVALID; }
    vec2 last = vec2(P.size.xy - 1);
    return any(lessThan(at, vec2(-P.guard_px))) || any(greaterThan(at, last + P.guard_px)) ? OUTSIDE : 0u;
}

// Bits of a pixel that is the same under every reprojection: SKY, and those of a pixel that has no history.
uint classify_current(ivec2 pixel, Sample now) {
    bool surface = is_surface(now.position);
    uint mask = surface ? 0u : SKY;
    if (P.declared != 0u) return mask | P.declared;
    if (non_finite(now)) return INVALID | (non_finite(now.position) ? 0u : mask); // sky only where it is known to be
#if CUTS
    // A surface that replaces another one has no counterpart in the frame before.
    if (surface && (ids_at(pixel).y & NO_HISTORY) != 0u) return CUT;
#endif
    return mask;
}

// Reason bits of one pixel, and its motion in pixels.  ``differs``: whether the other reprojection may give other bits; only
// where BOTH are counted and ``follow`` is MOTION.
uint classify(ivec2 pixel, bool follow, out vec2 motion, out bool differs) {
    motion = vec2(0.0);
    differs = false;
    Sample now = fetch_current(pixel);
    uint mask = classify_current(pixel, now);
    if ((mask & ~SKY) != 0u) return mask;
    vec3 q;
    uint unclassified = reproject(pixel, now.position, follow, q, motion);
    Sample before;
    if (unclassified == 0u) {
        before = sample_history(vec2(pixel) + motion, mask == 0u);
        mask |= non_finite(before) ? INVALID : compare(now, q, before);
    } else {
        mask |= unclassified;
    }
#if BOTH
    if (follow == bool(MOTION) && (mask & SKY) == 0u) {
        vec3 other_q;
        vec2 other_motion;
        uint other = reproject(pixel, now.position, !follow, other_q, other_motion);
        if ((unclassified | other) != 0u) {
            differs = unclassified != other;
        } else if (taps_differ(vec2(pixel) + motion, vec2(pixel) + other_motion)) {
            differs = true;
        } else if ((mask & (INVALID | HISTORY_SKY)) == 0u) { // the same history: only the position test can differ
            float moved, nearer;
            uint position = position_bits(other_q, before.position.xyz, moved, nearer);
            differs = position != (mask & (POSITION | DISOCCLUDED | OCCLUDING));
        }
    }
#endif
    return mask;
}

// An invocation classifies PIXELS_EACH (at most 64) pixels, a group's width apart, and counts runs of equal words with one
// atomic.  Pixels that BOTH reprojections may classify differently, few of an image, follow in a loop of their own.
void main() {
    load_parameters();
    ivec2 pixel = ivec2(gl_WorkGroupID.x * GROUP_X * PIXELS_EACH + gl_LocalInvocationID.x, gl_GlobalInvocationID.y);
    uint word = 0u, run = 0u;
#if BOTH
    ivec2 start = pixel;
    uvec2 differing = uvec2(0u); // a bit for each pixel
#endif
    for (int i = 0; i < PIXELS_EACH; ++i, pixel.x += GROUP_X) {
        if (any(greaterThanEqual(pixel, P.size.xy))) break;
        vec2 motion;
#if WRITE_DISTANCES
        pixel_distances = pixel_changes = vec4(0.0);
#endif
        bool differs;
        uint mask = classify(pixel, bool(MOTION), motion, differs);
#if BOTH
        if (differs) {
            differing |= i < 32 ? uvec2(1u << i, 0u) : uvec2(0u, 1u << (i - 32));
            atomicAdd(other_histogram[mask], ~0u); // less one
        }
#endif
        if (mask != word && run > 0u) {
            atomicAdd(mask_histogram[word], run);
            run = 0u;
        }
        word = mask;
        ++run;
#if WRITE_MASK
        imageStore(mask_out, pixel, uvec4(mask));
#endif
#if WRITE_MOTION
        imageStore(motion_out, pixel, vec4(motion, 0.0, 0.0));
#endif
#if WRITE_DISTANCES
        imageStore(distances_out, pixel, pixel_distances);
        imageStore(changes_out, pixel, pixel_changes);
#endif
    }
    if (run > 0u) atomicAdd(mask_histogram[word], run);
#if BOTH
    counts_distances = false;
    while ((differing.x | differing.y) != 0u) {
        int i = differing.x != 0u ? findLSB(differing.x) : 32 + findLSB(differing.y);
        differing &= i < 32 ? uvec2(~(1u << i), ~0u) : uvec2(~0u, ~(1u << (i - 32)));
        vec2 motion;
        bool differs;
        atomicAdd(other_histogram[classify(start + ivec2(i * GROUP_X, 0), !bool(MOTION), motion, differs)], 1u);
    }
#endif
}
