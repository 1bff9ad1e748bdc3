// Direct light of punctual lights at the pixels of a tile, every light with a shadow ray: no noise.
//
// Paper      section 3.2, f_dir.
// Reads      position normal geometric_normal base_color material, light table, acceleration structure.
// Writes     layers EXACT of the path state; lights first_light to
//            first_light + LIGHT_CHUNK - 1.
// Reference  metrics.lighting, ray casts
#include "pathtracing/state.glsl"
#include "pathtracing/light_sampling.glsl"
#include "pathtracing/camera_vertex.glsl"

uniform int first_light;

void main() {
    ivec2 local = local_pixel();
    if (outside_tile(local)) return;
    CameraVertex x = camera_vertex(local);
    Lobes sum = no_light();
    if (x.lit) {
        int end = min(first_light + LIGHT_CHUNK, P.lights.x);
        for (int row = first_light; row < end; ++row) {
            LightRecord light = light_record(row);
            Incident arriving = incident(light, x.p);
            if (!faces(x.surface, x.g, arriving.l) || !(luminance(arriving.radiance) > 0.0)) continue;
            vec3 origin = offset_origin(x.p, x.g, arriving.l);
            float reach = punctual_reach(light, origin);
            if (occluded(Ray(origin, arriving.l, reach))) continue;
#if VOLUME
            arriving.radiance *= transmittance(medium_towards(x.surface, x.g, arriving.l), reach);
#endif
            sum = plus(sum, times(evaluate_brdf(x.surface, arriving.l), arriving.radiance));
        }
    }
    if (first_light > 0) {
#define ADD_LIGHTS_BEFORE(lobe) sum.lobe += load_state(local, EXACT(lobe)).rgb;
        EACH_LOBE(ADD_LIGHTS_BEFORE)
    }
#define STORE_EXACT(lobe) store_state(local, EXACT(lobe), vec4(sum.lobe, 0.0));
    EACH_LOBE(STORE_EXACT)
}
