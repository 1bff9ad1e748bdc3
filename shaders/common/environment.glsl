// Radiance of an environment: uniform, or an equirectangular image with its center at +X and three quarters of its width at
// +Z.  Rows of the maps start at +Y.   Reference: metrics.environment, references.environment
#ifndef ENVIRONMENT_IMAGE
#define ENVIRONMENT_IMAGE 0
#endif

#if ENVIRONMENT_IMAGE
// Bilinear value in direction d of the map of ``size`` texels that starts at texel row ``first``.
vec3 environment_lookup(sampler2D map, ivec2 size, int first, vec3 d) {
    const float TURN = 6.28318530717959;
    vec2 at = vec2(atan(d.z, d.x) / TURN + 0.5, 2.0 * atan(length(d.xz), d.y) / TURN) * vec2(size) - 0.5;
    vec2 base = floor(at), f = at - base;
    int left = (int(base.x) + size.x) % size.x, right = (left + 1) % size.x;
    int top = first + clamp(int(base.y), 0, size.y - 1), bottom = first + clamp(int(base.y) + 1, 0, size.y - 1);
    vec3 low = mix(texelFetch(map, ivec2(left, top), 0).rgb, texelFetch(map, ivec2(right, top), 0).rgb, f.x);
    vec3 high = mix(texelFetch(map, ivec2(left, bottom), 0).rgb, texelFetch(map, ivec2(right, bottom), 0).rgb, f.x);
    return mix(low, high, f.y);
}

// The environment itself, in direction d.
vec3 environment_seen(vec3 d) { return environment_lookup(environment_map, textureSize(environment_map, 0), 0, d); }

#if ENVIRONMENT_LOBES
vec3 environment_lobe(int level, vec3 d) {
    return environment_lookup(environment_lobes, ivec2(2, 1) * LOBE_HEIGHT, level * LOBE_HEIGHT, d);
}

// Radiance that a white diffuse surface with normal n reflects.
vec3 environment_diffuse(vec3 n) { return environment_lobe(0, n); }

// Mean radiance that a lobe of perceptual roughness sees around the mirror direction.
vec3 environment_glossy(vec3 mirror, float roughness) {
    float at = clamp(roughness, 0.0, 1.0) * float(LOBE_LEVELS);
    int low = min(int(at), LOBE_LEVELS - 1);
    vec3 sharper = low == 0 ? environment_seen(mirror) : environment_lobe(low, mirror);
    return mix(sharper, environment_lobe(low + 1, mirror), at - float(low));
}
#endif
#endif
