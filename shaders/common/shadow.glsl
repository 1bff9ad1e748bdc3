// Shadow lookup against the plane of the receiver: each filter tap asks where the light's ray through *that texel's
// centre* meets the receiver's plane, so a plane never shadows itself and needs no bias that would detach its shadows.
// No twin: tests compare lit areas with closed forms.
#include "common/numbers.glsl"
#include "common/affine.glsl"

const float HALF_FLOAT = 1.0 / 1024.0; // relative rounding of a half float, where it is cut off rather than rounded

#ifndef SHADOW_RANDOM
#define SHADOW_RANDOM 0
#endif
#if SHADOW_RANDOM
vec2 shadow_random; // in [0, 1), set before every lookup
#endif

uniform sampler2D shadow_atlas;
uniform sampler2D shadow_faces; // a field a texel, a face a row

ShadowFace shadow_face(int i) {
    return ShadowFace(texelFetch(shadow_faces, ivec2(0, i), 0), texelFetch(shadow_faces, ivec2(1, i), 0),
                      texelFetch(shadow_faces, ivec2(2, i), 0), texelFetch(shadow_faces, ivec2(3, i), 0),
                      texelFetch(shadow_faces, ivec2(4, i), 0));
}

// Share of the light of face f that reaches p (relative to the camera) on a surface with geometric normal g.
float face_visibility(ShadowFace f, vec3 p, vec3 g) {
    vec3 q = p - f.origin.xyz;
    bool parallel = f.origin.w > 0.5;
    float z = dot(f.forward.xyz, q);
    vec2 at = vec2(dot(f.right.xyz, q), dot(f.up.xyz, q));
    if (!parallel) {
        if (z <= f.forward.w) return 1.0; // nearer than anything the map holds
        at /= z;
    }
    if (any(greaterThan(abs(at), vec2(1.0)))) return 1.0; // outside the map: nothing there casts
    float resolution = f.extent.x;
    vec2 texel = (at * 0.5 + 0.5) * resolution - 0.5;
    vec2 base = floor(texel), w = texel - base;
    // Half extents: f.right = axis / half, so axis * half = f.right / |f.right|^2.
    vec3 step_x = f.right.xyz / dot(f.right.xyz, f.right.xyz), step_y = f.up.xyz / dot(f.up.xyz, f.up.xyz);
    float plane = dot(g, q);
    float texel_size = f.extent.y * (parallel ? 1.0 : z);
    float lit = 0.0;
#if SHADOW_RANDOM // one of the bilinear filter's four taps, with its weight as the probability
    base += vec2(lessThan(shadow_random, w));
#elif SHADOW_TAPS == 1
    base = floor(texel + 0.5);
#endif
    for (int tap = 0; tap < SHADOW_TAPS; ++tap) {
        vec2 offset = vec2(float(tap & 1), float(tap >> 1));
        vec2 center = clamp(base + offset, vec2(0.0), vec2(resolution - 1.0));
        vec2 u = (center + 0.5) / resolution * 2.0 - 1.0;
        vec3 across = u.x * step_x + u.y * step_y;
        // Depth at which this texel's ray meets the receiver's plane.  At most a texel aside it is off by the plane's
        // slope; a ray almost in the plane meets it nowhere useful.
        float slant = dot(g, parallel ? f.forward.xyz : f.forward.xyz + across);
        float receiver = (parallel ? plane - dot(g, across) : plane) / slant;
        float reach = SHADOW_REACH * texel_size;
        receiver = non_finite(receiver) ? z : clamp(receiver, z - reach, z + reach);
        float s = texelFetch(shadow_atlas, ivec2(f.right.w, f.up.w) + ivec2(center), 0).r;
        float occluder = s <= 0.0 ? 3.0e38 : parallel ? (1.0 - s) * f.forward.w : f.forward.w / s;
        // Last term: the normal is stored in half floats, which tilts a slanting plane.
        float bias = SHADOW_BIAS * texel_size + 2e-5 * z + HALF_FLOAT * abs(receiver - z) / max(abs(slant), HALF_FLOAT);
#if SHADOW_TAPS == 1
        float weight = 1.0;
#else
        float weight = (tap & 1) == 1 ? w.x : 1.0 - w.x;
        weight *= (tap >> 1) == 1 ? w.y : 1.0 - w.y;
#endif
        lit += weight * (occluder >= receiver - bias ? 1.0 : 0.0);
    }
    return lit;
}

float visibility(LightRecord light, vec3 p, vec3 g) {
    int first = int(light.color.w);
    if (first < 0) return 1.0;
    int face = first;
    if (light.spot.z > 1.0) {
        vec3 q = p - light.position.xyz, a = abs(q);
        if (a.x >= a.y && a.x >= a.z) face += q.x >= 0.0 ? 0 : 1;
        else if (a.y >= a.z) face += q.y >= 0.0 ? 2 : 3;
        else face += q.z >= 0.0 ? 4 : 5;
    }
    return face_visibility(shadow_face(face), p, g);
}
