// Dilated depth, motion and masks; depth clip; tone-mapped color; thin features.  On the grid of the inputs.
//
// Paper    FSR2 documentation: "Reconstruct & dilate", "Depth clip", "Create locks".
// Reference references.reuse_methods.fsr2_dilate, fsr2_depth_clip, fsr2_tone_mapped, fsr2_thin_features
// Departs  The previous depth is that of the previous frame, sampled along the motion, where FSR2 scatters the current depth into
//          the previous frame with atomics.  Its tolerance is a fraction of the depth (depth_tolerance), not Akeley's separation of
//          a depth buffer: depth here is planar and in float32.
#include "tone.glsl"
#include "divergence.glsl"

// The fraction of the bilinear footprint at ``at`` in the previous frame that did not hide a surface of depth ``expected``
// (0: sky) behind a nearer one; 0 outside the image.
float depth_clip(vec2 at, float expected) {
    float sum = 0.0, total = 0.0;
    for (int i = 0; i < 4; ++i) {
        Tap t = bilinear_tap(at, i);
        if (t.weight <= 0.0 || !in_image(t.at)) continue;
        float before = fetch_prev_dilated(t.at).w, clear = 1.0;
        if (expected <= 0.0) clear = before > 0.0 ? 0.0 : 1.0;
        else if (before > 0.0 && expected > before)
            clear = min(depth_tolerance * before / (expected - before), 1.0);
        sum += t.weight * clear;
        total += t.weight;
    }
    return total > 0.0 ? sum / total : 0.0;
}

// A pixel that is brighter or darker than all dissimilar neighbors, and in no 2x2 square of similar ones: a line or a dot.
float thin_feature(ivec2 p) {
    float own = ycocg_from_rgb(tone_mapped(p)).x, low = 1.0e30, high = 0.0;
    uint similar = 0u; // bit of each of the nine; an array of bool crashes lavapipe of Mesa 22.3
    for (int i = 0; i < 9; ++i) {
        float other = ycocg_from_rgb(tone_mapped(p + ivec2(i % 3 - 1, i / 3 - 1))).x;
        if (i == 4 || max(own, other) < thin_ratio * min(own, other)) {
            similar |= 1u << i;
        } else {
            low = min(low, other);
            high = max(high, other);
        }
    }
    if (own >= low && own <= high) return 0.0;
    for (int i = 0; i < 4; ++i) {
        uint square = 27u << (i % 2 + 3 * (i / 2)); // bits 0, 1, 3 and 4
        if ((similar & square) == square) return 0.0;
    }
    return 1.0;
}

void reuse(ivec2 p) {
    ivec2 nearest = nearest_surface(p);
    float depth = fetch_position(nearest).w;
    float expected = depth > 0.0 ? dot(frame.prev_forward.xyz, fetch_prev_position(nearest).xyz) : 0.0;
    vec2 motion = fetch_motion(nearest);
    // Samples are at p + jitter: the pixel of the previous frame whose sample is there.
    vec2 at = vec2(p) + motion + frame.jitter_px - frame.prev_jitter_px;
    float clear = frame.has_history == 1u ? depth_clip(at, expected) : 0.0;
    write_dilated(p, vec4(motion, clear, depth));
    float reactive_most = 0.0, transparency_most = 0.0;
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            reactive_most = max(reactive_most, fetch_reactive(p + ivec2(x, y)));
            transparency_most = max(transparency_most, fetch_transparency(p + ivec2(x, y)));
        }
    write_masks(p, vec2(reactive_most, max(transparency_most, motion_divergence(p, motion))));
    write_prepared(p, vec4(tone_mapped(p), thin_feature(p)));
}
