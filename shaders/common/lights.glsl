// Punctual lights (KHR_lights_punctual): candela and lux, 1/d^2 with range window and spot falloff.
// Twin: metrics.lighting.incident
const float KIND_POINT = 0.0, KIND_SPOT = 1.0, KIND_DIRECTIONAL = 2.0, KIND_WIDE_SPOT = 3.0;

// What the scene holds no light of is compiled out; who defines nothing gets all of them.
#ifndef POINT_LIGHTS
#define POINT_LIGHTS 1
#define SPOT_LIGHTS 1
#define DIRECTIONAL_LIGHTS 1
#endif

#ifndef LISTED_LIGHTS
#define LISTED_LIGHTS 0
#endif

// Records of a float texture, a field a texel, LIGHT_ROW of them in a row: texture fetches are made for all lanes at once
// where reads of storage buffers are not (Mesa's llvmpipe), and image loads take half the time of a sampler's fetches.
#ifdef LIGHT_IMAGE // the binding, of who has one to spare
layout(rgba32f, binding = LIGHT_IMAGE) readonly uniform image2D light_table;

vec4 light_texel(ivec2 at) { return imageLoad(light_table, at); }
#else
uniform sampler2D light_table;

vec4 light_texel(ivec2 at) { return texelFetch(light_table, at, 0); }
#endif

LightRecord light_record(int i) {
    ivec2 at = ivec2(4u * (uint(i) % uint(LIGHT_ROW)), uint(i) / uint(LIGHT_ROW));
    return LightRecord(light_texel(at), light_texel(at + ivec2(1, 0)), light_texel(at + ivec2(2, 0)),
                       light_texel(at + ivec2(3, 0)));
}

#if LISTED_LIGHTS // the few that are compiled one by one, with what never changes of them
layout(std140, binding = 2) uniform Lights { LightRecord lights[LISTED_LIGHTS]; };

// i must be a constant: then a record is read once for all lanes, and kind and shadow map are known to the compiler.
LightRecord listed_light(int i) {
    LightRecord r = lights[i];
    r.direction.w = LISTED_KINDS[i];
    r.color.w = LISTED_FACES[i];
    return r;
}
#endif

struct Incident {
    vec3 l; // unit, towards the light
    vec3 radiance; // irradiance on a surface that faces the light
};

// p: relative to the camera, world axes.
Incident incident(LightRecord light, vec3 p) {
    Incident r;
    r.radiance = light.color.rgb;
#if DIRECTIONAL_LIGHTS
    if (light.direction.w == KIND_DIRECTIONAL) {
        r.l = -light.direction.xyz;
        return r;
    }
#endif
#if POINT_LIGHTS || SPOT_LIGHTS
    vec3 to_light = light.position.xyz - p;
    // A light on the surface itself must not divide by 0: nearer than MIN_LIGHT_DISTANCE counts as that far.
    float d2 = max(dot(to_light, to_light), MIN_LIGHT_DISTANCE * MIN_LIGHT_DISTANCE);
    r.l = safe_normalize(to_light);
    r.radiance /= d2;
    float range = light.position.w;
    if (range > 0.0) { // 0: unlimited
        float x = d2 / (range * range);
        r.radiance *= clamp(1.0 - x * x, 0.0, 1.0);
    }
#if SPOT_LIGHTS
    if (light.direction.w == KIND_SPOT || light.direction.w == KIND_WIDE_SPOT) {
        float cone = clamp(dot(light.direction.xyz, -r.l) * light.spot.x + light.spot.y, 0.0, 1.0);
        r.radiance *= cone * cone;
    }
#endif
#endif
    return r;
}
