// Punctual lights (KHR_lights_punctual): candela and lux with spot falloff x^2, or these over 683 with the cone of Cycles;
// 1/d^2 with range window, or constant with distance.
// Reference: references.punctual.incident
const float KIND_POINT = 0.0, KIND_SPOT = 1.0, KIND_DIRECTIONAL = 2.0, KIND_WIDE_SPOT = 3.0;

// Kinds of lights that the scene has none of are compiled out; without definitions all kinds are there.
#ifndef POINT_LIGHTS
#define POINT_LIGHTS 1
#define SPOT_LIGHTS 1
#define DIRECTIONAL_LIGHTS 1
#endif

#ifndef UNROLLED_LIGHTS
#define UNROLLED_LIGHTS 0
#endif

#ifdef light_table_at
// Records of a float texture, a field a texel, LIGHT_ROW records in a row.
#define LIGHT_RECORD_AT(texel, at) LightRecord(texel(at), texel(at + ivec2(1, 0)), texel(at + ivec2(2, 0)), texel(at + ivec2(3, 0)))

ivec2 light_texel(int i) { return ivec2(4u * (uint(i) % uint(LIGHT_ROW)), uint(i) / uint(LIGHT_ROW)); }

LightRecord light_record(int i) {
    ivec2 at = light_texel(i);
    return LIGHT_RECORD_AT(light_table_at, at);
}
#endif

#if UNROLLED_LIGHTS
// i must be a constant: then kind and shadow map are known to the compiler (frame/lights.py).
LightRecord unrolled_light(int i) {
    LightRecord r = unrolled_lights[i];
    r.direction.w = UNROLLED_KINDS[i];
    r.color.w = UNROLLED_FACES[i];
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
    if (light.spot.w == 0.0) r.radiance /= d2; // 1: constant with distance
    float range = light.position.w;
    if (range > 0.0) { // 0: unlimited
        float x = d2 / (range * range);
        r.radiance *= clamp(1.0 - x * x, 0.0, 1.0);
    }
#if SPOT_LIGHTS
    if (light.direction.w == KIND_SPOT || light.direction.w == KIND_WIDE_SPOT) {
        float cone = clamp(dot(light.direction.xyz, -r.l) * light.spot.x + light.spot.y, 0.0, 1.0);
        r.radiance *= cone * cone * (1.0 + light.spot.z * (2.0 - 2.0 * cone));
    }
#endif
#endif
    return r;
}
