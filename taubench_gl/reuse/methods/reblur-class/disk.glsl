// Weights of a blur over a disk in the tangent plane of a surface, in world space.
//
// Paper    Zhdanov 2021, ReBLUR: disks in world space, weights by plane distance, normal, hit distance and roughness.
// Reference references.reuse_methods.disk_offset, kernel_angle, tangents, hit_factor, lobe_factor
// Departs  Eight taps on a Vogel spiral, turned by a hash of pixel and frame; the published description has a Poisson disk.
//          The disk of the specular lobe is round and in the tangent plane, too.

const int TAPS = 8;

// Width of a pixel at planar depth ``depth``, meters.
float pixel_size(float depth) { return length(frame.sky_dx.xyz) * (frame.sky_origin.w > 0.5 ? 1.0 : depth); }

// Height or width of what the camera sees at this depth, the smaller of both, meters.
float frustum_size(float depth) { return pixel_size(depth) * float(min(frame.size.x, frame.size.y)); }

float kernel_angle(ivec2 p, int salt) {
    uint h = uint(p.x) * 1973u + uint(p.y) * 9277u + uint(frame.index) * 26699u + uint(salt) * 7919u;
    h = (h ^ (h >> 16)) * 0x7feb352du;
    h = (h ^ (h >> 15)) * 0x846ca68bu;
    h ^= h >> 16;
    return 6.283185307 * float(h >> 8) / 16777216.0;
}

// Tap i in the unit disk.
vec2 disk_offset(int i, float angle) {
    float a = angle + 2.399963230 * float(i);
    return sqrt((float(i) + 0.5) / float(TAPS)) * vec2(cos(a), sin(a));
}

// Duff et al. 2017: two unit vectors perpendicular to a unit normal.
void tangents(vec3 n, out vec3 t, out vec3 b) {
    float s = n.z >= 0.0 ? 1.0 : -1.0, a = -1.0 / (s + n.z), c = n.x * n.y * a;
    t = vec3(1.0 + s * n.x * n.x * a, s * c, -s * n.x);
    b = vec3(c, s + n.y * n.y * a, -n.y);
}

// The pixel that shows a point relative to this camera; ``otherwise`` where it is behind the near plane.
ivec2 pixel_of(vec3 point, ivec2 otherwise) {
    vec4 clip = frame.clip_from_current * vec4(point, 1.0);
    if (clip.w <= frame.near) return otherwise;
    return ivec2(floor((0.5 * clip.xy / clip.w + 0.5) * vec2(frame.size.xy)));
}

// Light from near needs a small kernel: contact shadows and contact reflections.  0: no hit, light from afar.
float hit_factor(float hit, float depth) { return hit > 0.0 ? min(hit / frustum_size(depth), 1.0) : 1.0; }

// Width of the lobe relative to a diffuse one.
float lobe_factor(float roughness) { return sqrt(roughness); }

// Weight of pixel q in the blur of pixel p by plane distance and normal; 0 for the sky.
float surface_weight(vec4 p, vec3 n, vec4 q, vec3 other_n, float lobe) {
    if (!(q.w > 0.0)) return 0.0;
    float plane = abs(dot(n, q.xyz - p.xyz)) / (plane_limit * frustum_size(p.w));
    float turn = (1.0 - dot(n, other_n)) / (normal_limit * max(lobe, 0.05));
    return max(1.0 - plane, 0.0) * max(1.0 - turn, 0.0);
}

// By hit distance: light from near and light from afar are not mixed.
float hit_weight(float hit, float other) {
    return exp(-abs(hit - other) / (hit_limit * max(hit, other) + 1.0e-6));
}

// Radii are given in pixels of an image with 1080 rows.
float rows() { return float(frame.size.y) / 1080.0; }
