// What the light samples of reservoirs reach in this frame, by shadow rays, and which lights were born or are gone for a pixel.
//
// Reads      history_sample kept_sample (contract.REPORTS, rows bottom-up) position prev_position motion changed_lights
// Writes     sample_facts: x: bits of sample_rays.Fact; y: number of the born light that reflects most here, -1: none reaches the
//            pixel; z: luminance of that light, exposure not applied
// Reference  references.sample_scores
#include "reuse/light.glsl"

uniform ivec2 size;
uniform float moved_from; // length from which a point has moved, scene units

bool lights(SurfacePoint x, LightPoint at) { return luminance(reflected(x, at)) > 0.0 && visible(x, at); }

bool reaches(SurfacePoint x, vec4 kept) { return kept.x >= 0.0 && lights(x, light_at(int(kept.x), kept.yz)); }

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, size))) return;
    SurfacePoint x = surface_at(p);
    vec3 facts = vec3(0.0, -1.0, 0.0);
    if (x.lit) {
        int bits = FACT_LIT;
        if (reaches(x, texelFetch(history_sample, p, 0))) bits |= FACT_HISTORY_REACHES;
        if (reaches(x, texelFetch(kept_sample, p, 0))) bits |= FACT_KEPT_REACHES;
        vec3 shift = texelFetch(position, p, 0).xyz + light_frame[0].camera_delta.xyz - texelFetch(prev_position, p, 0).xyz;
        if (length(shift) > moved_from) bits |= FACT_MOVED;
        for (int i = 0; i < changed_lights[0]; ++i) {
            LightPoint at = light_at(changed_lights[2 + i], vec2(0.5));
            if (!lights(x, at)) continue;
            bits |= FACT_BORN;
            float share = luminance(reflected(x, at));
            if (share > facts.z) facts.yz = vec2(float(changed_lights[2 + i]), share);
        }
        SurfacePoint before = prev_surface_at(ivec2(floor(vec2(p) + texelFetch(motion, p, 0).xy + 0.5)));
        for (int i = 0; i < changed_lights[1]; ++i) {
            LightPoint was = prev_light_at(changed_lights[2 + changed_lights[0] + i], vec2(0.5));
            if (luminance(reflected(before, was)) > 0.0 && prev_visible(before, was)) bits |= FACT_GONE;
        }
        facts.x = float(bits);
    }
    imageStore(sample_facts, p, vec4(facts, 0.0));
}
