// Upsampling of the jittered samples around pixel p of the result, and the box of their colors.
//
// Paper    FSR2 documentation: "Reproject & accumulate": Lanczos weights of the distance from p to the samples of 4x4 input
//          pixels, the kernel scaled by ``sharp``; the sum of the weights is the weight of the color.  Box for the rectification: mean and
//          standard deviation in YCoCg, weights exp(-3 d^2), within the range of the colors of 3x3 pixels.
// Reference references.reuse_methods.fsr2_upsample
// Departs  Samples outside the image have no weight, but the color takes those at the border for them, where FSR2 leaves them out:
//          what remains of the kernel can be mostly its negative lobes, and the color then any corner of the box.
//          The color is limited to the range of the samples in RGB, where FSR2 limits it in YCoCg: corners of that box lie
//          outside the range of RGB, and the inverse tone map makes them brighter than every sample.
#include "lanczos.glsl"

struct Upsampled {
    vec4 color;                        // rgb, a: weight
    vec3 least, most;                  // range of the samples, RGB
    vec3 middle, deviation, low, high; // box, YCoCg
};

bool in_inputs(ivec2 q) { return all(greaterThanEqual(q, ivec2(0))) && all(lessThan(q, input_size())); }

Upsampled upsample(vec2 at, float sharp) {
    vec2 pixel = at - frame.jitter_px; // in pixel indices of the samples
    ivec2 nearest = ivec2(floor(pixel + 0.5)), base = ivec2(floor(pixel)) - 1;
    Upsampled u;
    vec4 sum = vec4(0.0);
    float there = 0.0; // weight of the samples inside the image
    for (int i = 0; i < 16; ++i) {
        ivec2 q = base + ivec2(i % 4, i / 4);
        float w = lanczos2(sharp * length(vec2(q) - pixel));
        sum += w * vec4(fetch_prepared(q).rgb, 1.0);
        if (in_inputs(q)) there += w;
    }
    vec3 m1 = vec3(0.0), m2 = vec3(0.0);
    u.low = u.least = vec3(1.0e30);
    u.high = u.most = vec3(-1.0e30);
    float total = 0.0;
    for (int i = 0; i < 9; ++i) {
        ivec2 q = nearest + ivec2(i % 3 - 1, i / 3 - 1);
        if (!in_inputs(q)) continue;
        vec3 rgb = fetch_prepared(q).rgb, c = ycocg_from_rgb(rgb);
        vec2 d = vec2(q) - pixel;
        float w = exp(-3.0 * dot(d, d));
        m1 += w * c;
        m2 += w * c * c;
        total += w;
        u.least = min(u.least, rgb);
        u.most = max(u.most, rgb);
        u.low = min(u.low, c);
        u.high = max(u.high, c);
    }
    u.middle = m1 / total;
    u.deviation = sqrt(max(m2 / total - u.middle * u.middle, 0.0));
    bool enough = sum.a > 1.0e-3;
    vec3 color = enough ? sum.rgb / sum.a : rgb_from_ycocg(u.middle);
    u.color = vec4(clamp(color, u.least, u.most), enough ? max(there, 0.0) : 0.0);
    return u;
}
