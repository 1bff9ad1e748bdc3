// Reprojection, shading change, locks, rectification and accumulation.  On the grid of the result.
//
// Paper    FSR2 documentation: "Create locks", "Reproject & accumulate", "Reactive mask", "Transparency & composition mask".
//          Constants (12 and 3 for the weight of the history, 0.74 for the mean weight of a frame, box 1 + (scale - 1) / 2) as published.
// Reference references.reuse_methods.fsr2_accumulate, fsr2_shading_luminance, fsr2_new_locks, fsr2_unstable, fsr2_weight_limit,
//          fsr2_rectified
// Departs  Locks are found by the pixel that contains a thin sample, where FSR2 writes them from the sample.  The color is kept
//          tone-mapped, because the caller applies the exposure.  A luminance is unstable if it returns to that of an
//          older frame within half of its last change, in a box as wide as AMD's shader asks for.
//          The rectified history is limited in RGB to the range between the history and the samples.
#include "upsample.glsl"
#include "history.glsl"

const float MOST_MOVING = 3.0;  // largest weight of the history of a moving pixel
const float MEAN_WEIGHT = 0.74; // of the upsampled color of one frame
const float FLICKER = 1.0 / 255.0;
const float FLICKER_BOX = 0.03970968; // 0.1 FLICKER^(1/6): narrower boxes need no protection
const float STEADY = 0.1; // largest disocclusion, composition and shading change with which older luminances count

float shading_luminance(vec2 at) {
    const int side = 16;
    vec2 block = (at + 0.5) / float(side) - 0.5;
    ivec2 last = (input_size() - 1) / side;
    float sum = 0.0;
    for (int i = 0; i < 4; ++i) {
        Tap t = bilinear_tap(block, i);
        sum += t.weight * fetch_pyramid(side * clamp(t.at, ivec2(0), last));
    }
    return exp(sum);
}

// Whether a thin feature was sampled in pixel p.
bool new_lock(ivec2 p, vec2 at) {
    ivec2 nearest = ivec2(floor(at - frame.jitter_px + 0.5));
    for (int i = 0; i < 9; ++i) {
        ivec2 q = nearest + ivec2(i % 3 - 1, i / 3 - 1);
        if (!in_inputs(q)) continue;
        ivec2 holder = ivec2(floor(output_from_input(vec2(q) + frame.jitter_px) + 0.5));
        if (all(equal(holder, p)) && fetch_prepared(q).a > 0.5) return true;
    }
    return false;
}

bool unstable(float now, float deviation, vec4 before) {
    float change = abs(now - before.x);
    if (before.x <= 0.0 || change < FLICKER || deviation <= FLICKER_BOX) return false;
    for (int i = 1; i < 4; ++i)
        if (before[i] > 0.0 && abs(now - before[i]) <= 0.5 * change) return true;
    return false;
}

void reuse(ivec2 p) {
    vec2 at = input_from_output(vec2(p));
    vec2 pixel = at - frame.jitter_px;
    ivec2 sample_px = ivec2(floor(pixel + 0.5));
    vec2 motion = fetch_dilated(sample_px).xy * output_scale();
    vec2 before_at = vec2(p) + motion;
    float velocity = length(motion), moving = clamp(10.0 * velocity, 0.0, 1.0);
    float clear = clamp(sample_dilated(pixel).z, 0.0, 1.0);
    float reactivity = 1.0 - pow(1.0 - fetch_masks(sample_px).x, 3.0);
    float composed = sample_masks(pixel).y;

    bool exists = frame.has_history == 1u && inside(before_at);
    vec4 history = exists ? reprojected_color(before_at) : vec4(0.0);
    vec3 lock = exists ? sample_prev_lock(before_at).xyz : vec3(0.0); // lifetime, luminance, trust
    vec4 earlier = exists ? nearest_prev_luminances(before_at) : vec4(0.0);

    float shading = shading_luminance(at);
    float shading_before = lock.y > 0.0 ? lock.y : shading;
    float change = 1.0 - min(shading, shading_before) / max(shading, shading_before);
    lock.y = mix(shading_before, shading, 0.5);
    bool was_locked = lock.z > 0.0, fresh = new_lock(p, at);
    if (fresh) lock.x = lock.x > 0.0 ? 2.0 : 1.0;
    if (change > shading_change || (!fresh && clear < 0.99)) lock.x = 0.0;

    float least = MOST_MOVING / max_weight;
    float limit = min(min(1.0 - reactivity, mix(1.0, least, moving)), min(clear, max(least, 1.0 - change)));
    limit = max_weight * min(limit, (1.0 - change) * (1.0 - change));
    if (fresh && !was_locked) limit = MOST_MOVING;
    float weight = min(history.a, limit);
    lock.z = min(lock.z, min(1.0 - pow(reactivity, 1.0 / 3.0), clear));

    float bias = clamp((weight - 0.5) / 3.0, 0.0, 1.0) * (1.0 - composed);
    vec2 scale = output_scale();
    float sharp = 1.0 + (max(scale.x, scale.y) - 1.0) * bias * min(lock.z, 1.0 - reactivity);
    sharp = min(sharp * (0.5 + 0.5 * clear), 1.99);
    Upsampled now = upsample(at, exists ? sharp : 1.0);

    float luma = ycocg_from_rgb(now.color.rgb).x;
    bool flickers = max(max(1.0 - clear, composed), change) < STEADY && unstable(luma, now.deviation.x, earlier);
    if (weight > 0.0) {
        float locked = clamp(4.0 * lock.x, 0.0, 1.0) * (1.0 - reactivity) * float(composed < 0.9);
        vec3 reach = now.deviation * (1.0 + 0.5 * (max(scale.x, scale.y) - 1.0));
        vec3 low = max(now.low, now.middle - reach), high = min(now.high, now.middle + reach);
        vec3 before = ycocg_from_rgb(history.rgb), clamped = clamp(before, low, high);
        vec3 apart = abs(before - now.middle);
        vec3 part = mix(abs(clamped - now.middle) / max(apart, vec3(1.0e-9)), vec3(1.0), equal(clamped, before));
        part = clamp((part + max(locked, float(flickers))) * clear * clear, 0.0, 1.0);
        vec3 near = clamp(rgb_from_ycocg(clamped), now.least, now.most), kept = rgb_from_ycocg(mix(clamped, before, part));
        history.rgb = clamp(kept, min(near, history.rgb), max(near, history.rgb));
    }
    float total = weight + now.color.a;
    float share = weight > 0.0 ? now.color.a / total : 1.0;
    vec3 color = mix(history.rgb, now.color.rgb, share);
    total = min(total, mix(max_weight, MOST_MOVING, moving));
    write_color(p, vec4(color, max(total - now.color.a * reactivity, 0.0)));
    float periods = ceil(8.0 * scale.x * scale.y);
    lock.z = min(1.0, lock.z + now.color.a / 12.0);
    lock.x = max(lock.x - now.color.a / (MEAN_WEIGHT * periods), 0.0);
    write_lock(p, vec4(lock, 1.0 - share));
    write_luminances(p, vec4(luma, earlier.xyz));
}
