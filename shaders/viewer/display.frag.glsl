// Displays a channel under mask colors, optionally compared with the same channel of another source.
//
// Reads      one channel, position, mask (reason bits); with COMPARE the same channel of another source or of history, at
//            the same pixel or, with REPROJECTED, where motion leads; with OBSERVER mask and position of the frozen
//            camera, which is viewed from outside.
// Writes     display colors, RGBA8.
// Reference  references.display (channel_rgb), report.mask_images.mask_overlay (stripes)
#include "common/numbers.glsl"

#if KIND == KIND_IDS
uniform usampler2D channel;
#define VALUE uvec4
#else
uniform sampler2D channel;
#define VALUE vec4
#endif
#if COMPARE
#if KIND == KIND_IDS
uniform usampler2D other;
#else
uniform sampler2D other;
#endif
uniform sampler2D other_position;
uniform float split_px; // this source on the left, the other on the right
uniform float gain;     // factor of the difference
#if REPROJECTED
uniform sampler2D motion;
#endif
#endif
uniform sampler2D position;
uniform usampler2D mask;
#if COARSE_MASKS
uniform usampler2D light_mask; // of the coarse light
#endif
uniform vec2 value_range;
#if REASONS
uniform uint bits[REASONS]; // of the masks shown
uniform uint colors[REASONS]; // 8 bits per channel
#endif
uniform uint all_bits; // union of bits
uniform float opacity;
uniform ivec2 size;   // of the image
uniform ivec2 origin; // image pixel of the first fragment: a part of the image can be drawn
#if KIND == KIND_OBJECT_MOTION
uniform mat4 prev_clip_from_prev;
uniform vec3 camera_delta;
#endif
#if OBSERVER
uniform sampler2D frozen_position;
uniform mat4 frozen_clip;   // clip <- relative to the frozen camera
uniform vec3 frozen_delta;  // viewing camera - frozen camera, world, scene units
#endif
out vec4 out_color;

const vec3 NOTHING = vec3(BACKGROUND);

float span() { return max(value_range.y - value_range.x, 1e-12); }

vec3 srgb(vec3 x) {
    vec3 curve = 1.055 * pow(max(x, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
    return mix(curve, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

vec3 color_scale(float t) {
    float x = clamp(t, 0.0, 1.0) * float(STOPS - 1);
    int i = min(int(floor(x)), STOPS - 2);
    return mix(SCALE[i], SCALE[i + 1], x - float(i));
}

vec3 display_color(VALUE v, vec4 p) {
#if KIND == KIND_IDS
    uint x = v.x * 2654435761u;
    return v.x == 0u ? vec3(0.0) : 0.25 + 0.75 * vec3(x & 255u, (x >> 8) & 255u, (x >> 16) & 255u) / 255.0;
#else
    if (non_finite(v.xyz)) return vec3(1.0, 0.0, 1.0);
#if KIND == KIND_ENCODED
    return v.rgb;
#elif KIND == KIND_RADIANCE
    return srgb(clamp((v.rgb - value_range.x) / span(), 0.0, 1.0));
#elif KIND == KIND_MOTION
    float turn = fract(atan(v.y, v.x) / 6.283185307179586);
    vec3 hue = clamp(abs(mod(turn * 6.0 + vec3(0.0, 4.0, 2.0), 6.0) - 3.0) - 1.0, 0.0, 1.0);
    float far = length(v.xy);
    return far > 0.0 ? hue * clamp((far - value_range.x) / span(), 0.0, 1.0) : vec3(0.0); // zero motion has no direction
#else
    if (p.w <= 0.0) return NOTHING;
#if KIND == KIND_HEADLIGHT
    float far = length(p.xyz);
    return vec3(0.25 + 0.75 * abs(dot(v.xyz, p.xyz)) / (far > 0.0 ? far : 1.0));
#elif KIND == KIND_UNIT
    return 0.5 + 0.5 * v.xyz;
#elif KIND == KIND_VECTOR
    return (v.xyz - value_range.x) / span();
#elif KIND == KIND_DEPTH
    return color_scale((v.w - value_range.x) / span());
#elif KIND == KIND_OBJECT_MOTION
    // Distance in pixels between the previous positions of the surface point and of a static point at the same place.
    vec3 static_point = p.xyz + camera_delta;
    vec4 a = prev_clip_from_prev * vec4(v.xyz, 1.0), b = prev_clip_from_prev * vec4(static_point, 1.0);
    if (a.w <= 0.0 || b.w <= 0.0) return color_scale(0.0);
    float error = length((a.xy / a.w - b.xy / b.w) * 0.5 * vec2(size));
    return color_scale((error - value_range.x) / span());
#endif
#endif
#endif
}

// Without jumps, which llvmpipe does not take: it computes both sides for every pixel, and integer division by lanes.
vec3 with_masks(vec3 color, uint word, ivec2 at) {
#if REASONS
    uint chosen = 0u;
#if REASONS > 1
    int count = 0, place = 0;
    for (int i = 0; i < REASONS; ++i) count += (word & bits[i]) != 0u ? 1 : 0;
    float stripe = float((size.y - 1 - at.y + at.x) / STRIPE), each = float(max(count, 1));
    int turn = int(stripe - each * floor((stripe + 0.5) / each)); // stripe modulo count
    for (int i = 0; i < REASONS; ++i) {
        bool set = (word & bits[i]) != 0u;
        chosen = set && place == turn ? colors[i] : chosen;
        place += set ? 1 : 0;
    }
#else
    chosen = colors[0];
#endif
    color = mix(color, unpackUnorm4x8(chosen).rgb, (word & all_bits) != 0u ? opacity : 0.0);
#endif
    return color;
}

bool in_image(ivec2 at) { return all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, size)); }

#if COARSE && (KIND == KIND_ENCODED || KIND == KIND_RADIANCE)
// Between the centers of coarse pixels, by the sampler: on llvmpipe every texelFetch is a function call.
#define VALUE_AT(image, at) texture(image, (vec2(at) + 0.5) / vec2(size))
#else
#define VALUE_AT(image, at) texelFetch(image, at, 0)
#endif

uint mask_at(ivec2 at) {
    uint word = texelFetch(mask, at, 0).r;
#if COARSE_MASKS
    ivec2 there = ivec2((vec2(at) + 0.5) * (vec2(textureSize(light_mask, 0)) / vec2(size)));
    if ((word & NOT_COMPARABLE) == 0u) word |= texelFetch(light_mask, there, 0).r & LIGHT_BITS;
#endif
    return word;
}

#if COMPARE
vec3 other_color(ivec2 at) {
    ivec2 from = at;
#if REPROJECTED
    if ((texelFetch(mask, at, 0).r & NOT_COMPARABLE) != 0u) return NOTHING;
    from = ivec2(floor(vec2(at) + texelFetch(motion, at, 0).xy + 0.5));
#endif
    if (!in_image(from)) return NOTHING;
    return clamp(display_color(VALUE_AT(other, from), texelFetch(other_position, from, 0)), 0.0, 1.0);
}
#endif

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy) + origin;
    out_color = vec4(vec3(0.0), 1.0);
    if (!in_image(at)) return;
    vec4 p = texelFetch(position, at, 0);
    vec3 color = clamp(display_color(VALUE_AT(channel, at), p), 0.0, 1.0);
#if COMPARE == COMPARE_SPLIT
    if (float(at.x) >= split_px) color = other_color(at);
    if (abs(float(at.x) + 0.5 - split_px) < 1.0) color = vec3(1.0);
#elif COMPARE == COMPARE_DIFFERENCE
    color = clamp(gain * abs(color - other_color(at)), 0.0, 1.0);
#elif COMPARE == COMPARE_ERROR || COMPARE == COMPARE_GHOST
    vec3 shown = other_color(at), difference = abs(color - shown);
    color = color_scale(gain * max(difference.r, max(difference.g, difference.b)));
#if COMPARE == COMPARE_GHOST
    if (VALUE_AT(other, at).a < 0.5) color = vec3(0.25 * dot(shown, vec3(0.2126, 0.7152, 0.0722))); // dark gray
#endif
#elif COMPARE == COMPARE_OTHER
    color = other_color(at);
#endif
#if OBSERVER
    // Points that the frozen camera sees carry its masks; all others are dark.
    vec3 point = p.xyz + frozen_delta;
    vec4 clip = frozen_clip * vec4(point, 1.0);
    vec2 there = (clip.xy / clip.w * 0.5 + 0.5) * vec2(size);
    ivec2 pixel = ivec2(floor(there));
    bool seen = p.w > 0.0 && clip.w > 0.0 && in_image(pixel);
    if (seen) {
        vec4 frozen = texelFetch(frozen_position, pixel, 0);
        seen = frozen.w > 0.0 && length(point) <= length(frozen.xyz) * 1.02 + 1e-4;
    }
    if (!seen) color *= 0.3;
    else color = with_masks(color, texelFetch(mask, pixel, 0).r, at);
#else
    color = with_masks(color, mask_at(at), at);
#endif
    out_color = vec4(color, 1.0);
}
