// Shadow lookup against the plane of the receiver: each filter tap compares the depth at which the light's ray through
// *that texel's center* meets the receiver's plane, so a plane never shadows itself and needs no bias that would detach its
// shadows.  No float64 reference: tests compare lit areas with closed forms.
#include "common/numbers.glsl"
#include "common/affine.glsl"

const float HALF_FLOAT = 1.0 / 1024.0; // relative rounding of a half float, where it is cut off rather than rounded

#ifndef SHADOW_RANDOM
#define SHADOW_RANDOM 0
#endif
#if SHADOW_RANDOM
vec2 shadow_random; // in [0, 1), set before every lookup
#endif

#if UNROLLED_LIGHTS
ShadowFace shadow_face(int i) { return unrolled_faces[i]; }
vec2 face_corner(int i) { return vec2(unrolled_faces[i].right.w, unrolled_faces[i].up.w); }
#else // a field a texel, FACE_ROW faces in a row
ivec2 face_texel(int i) { return ivec2(5u * (uint(i) % uint(FACE_ROW)), uint(i) / uint(FACE_ROW)); }
ShadowFace shadow_face(int i) {
    ivec2 at = face_texel(i);
    return ShadowFace(shadow_faces_at(at), shadow_faces_at(at + ivec2(1, 0)), shadow_faces_at(at + ivec2(2, 0)),
                      shadow_faces_at(at + ivec2(3, 0)), shadow_faces_at(at + ivec2(4, 0)));
}
vec2 face_corner(int i) {
    ivec2 at = face_texel(i);
    return vec2(shadow_faces_at(at + ivec2(1, 0)).w, shadow_faces_at(at + ivec2(2, 0)).w);
}
#endif

// A receiver as one face sees it.
struct Receiver {
    vec3 q; // place in units of the face's half extents, z: meters along its axis
    vec3 g; // normal: slope of the plane per half extent, z: along the axis
    float plane; // distance of the plane from the face's origin, meters
    ivec2 corner; // of the face in the atlas
};

Receiver receiver_of(ShadowFace f, vec3 q, vec3 g) {
    // Half extents: f.right = axis / half, so axis * half = f.right / |f.right|^2.
    vec3 slope = vec3(dot(g, f.right.xyz) / dot(f.right.xyz, f.right.xyz), dot(g, f.up.xyz) / dot(f.up.xyz, f.up.xyz),
                      dot(g, f.forward.xyz));
    return Receiver(vec3(dot(f.right.xyz, q), dot(f.up.xyz, q), dot(f.forward.xyz, q)), slope, dot(g, q),
                    ivec2(f.right.w, f.up.w));
}

// The same for the cube of a point light or a wide spot, whose axes are the world's (frame/shadow_faces.py).
Receiver receiver_of_cube(int first, vec3 q, vec3 g) {
    vec3 a = abs(q);
    bool x = a.x >= a.y && a.x >= a.z, y = !x && a.y >= a.z;
    float major = x ? q.x : y ? q.y : q.z;
    bool back = !(major >= 0.0);
    float side = back ? -1.0 : 1.0;
    Receiver r;
    r.q = vec3((x ? q.z : y ? q.x : -q.x) * side, y ? q.z : q.y, abs(major));
    r.g = vec3((x ? g.z : y ? g.x : -g.x) * side, y ? g.z : g.y, (x ? g.x : y ? g.y : g.z) * side);
    r.plane = dot(g, q);
#if UNROLLED_LIGHTS // a choice of six constants, not one index that differs from lane to lane
    vec2 corner = face_corner(first + 4);
    corner = x ? face_corner(first) : y ? face_corner(first + 2) : corner;
    vec2 behind = face_corner(first + 5);
    behind = x ? face_corner(first + 1) : y ? face_corner(first + 3) : behind;
    r.corner = ivec2(back ? behind : corner);
#else
    r.corner = ivec2(face_corner(first + (x ? 0 : y ? 2 : 4) + (back ? 1 : 0)));
#endif
    return r;
}

// Share of the light that reaches the receiver; f: its face, or the first of its cube.  Where it is
// not needed the result is undefined, and one texel is read for all.
float face_visibility(ShadowFace f, bool parallel, Receiver r, bool needed) {
    float z = r.q.z, depth = parallel ? 1.0 : z; // depth: what a texel's size grows with
    vec2 at = r.q.xy / depth;
    float resolution = f.extent.x;
    vec2 texel = (at * 0.5 + 0.5) * resolution - 0.5;
    // The four texels about the point; at the edge of the map the last four, of which the outer two have all the weight.
    vec2 base = clamp(floor(texel), vec2(0.0), vec2(resolution - 2.0)), w = clamp(texel - base, vec2(0.0), vec2(1.0));
#if SHADOW_RANDOM // one of the bilinear filter's four taps, with its weight as the probability
    base += vec2(lessThan(shadow_random, w));
#elif SHADOW_TAPS == 1
    base = clamp(floor(texel + 0.5), vec2(0.0), vec2(resolution - 1.0));
#else
    vec2 middle = needed ? vec2(r.corner) + base + 1.0 : vec2(1.0); // where the four texels meet
    vec4 taps = textureGather(shadow_atlas, middle / vec2(textureSize(shadow_atlas, 0)));
#endif
    float texel_size = f.extent.y * depth;
    float reach = SHADOW_REACH * texel_size, bias = SHADOW_BIAS * texel_size + 2e-5 * z;
    // The rays' slants against the plane are linear in the texels' places.
    vec2 across = ((base + 0.5) / resolution * 2.0 - 1.0) * r.g.xy, more = 2.0 / resolution * r.g.xy;
    float lit = 0.0;
    for (int tap = 0; tap < SHADOW_TAPS; ++tap) {
        float beside = across.x + across.y + ((tap & 1) == 1 ? more.x : 0.0) + ((tap >> 1) == 1 ? more.y : 0.0);
        // Depth at which this texel's ray meets the receiver's plane.  It differs by at most the plane's slope
        // over one texel; a ray almost in the plane is clamped.
        float inverse = 1.0 / (parallel ? r.g.z : r.g.z + beside);
        float receiver = (parallel ? r.plane - beside : r.plane) * inverse;
        receiver = non_finite(receiver) ? z : clamp(receiver, z - reach, z + reach);
        // Last term: the normal is stored in half floats, which tilts a slanting plane.
        float nearest = receiver - (bias + HALF_FLOAT * abs(receiver - z) * min(abs(inverse), 1.0 / HALF_FLOAT));
#if SHADOW_TAPS == 1
        float s = shadow_atlas_at(r.corner + ivec2(base)).r, weight = 1.0;
#else
        float s = taps[int[](3, 2, 0, 1)[tap]]; // a gather goes round from the upper left
        float weight = ((tap & 1) == 1 ? w.x : 1.0 - w.x) * ((tap >> 1) == 1 ? w.y : 1.0 - w.y);
#endif
        // The occluder's depth, forward.w / s or (1 - s) forward.w, is at least ``nearest``; s = 0: there is none.
        bool open = parallel ? s <= 0.0 || (1.0 - s) * f.forward.w >= nearest : f.forward.w >= nearest * s;
        lit += open ? weight : 0.0;
    }
    // Nearer than anything the map holds, or outside the map, where nothing casts.
    return (!parallel && z <= f.forward.w) || any(greaterThan(abs(at), vec2(1.0))) ? 1.0 : lit;
}

// Share of the light that reaches p (relative to the camera) on a surface with geometric normal g; undefined unless needed.
float visibility(LightRecord light, vec3 p, vec3 g, bool needed) {
    int first = int(light.color.w);
    if (first < 0) return 1.0;
    ShadowFace f = shadow_face(first);
    vec3 q = p - f.origin.xyz;
    Receiver r;
    if (light.direction.w == KIND_POINT || light.direction.w == KIND_WIDE_SPOT) r = receiver_of_cube(first, q, g);
    else r = receiver_of(f, q, g);
    return face_visibility(f, light.direction.w == KIND_DIRECTIONAL, r, needed);
}
