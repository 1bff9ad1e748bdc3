// Direct light of punctual lights at the pixels of a tile, every light with a shadow ray: no noise.
//
// Paper      section 3.2, f_dir.
// Reads      position normal geometric_normal base_color material, light table, acceleration structure.
// Writes     layers EXACT of the path state: light of LIGHT_CHUNK more of the lights that would shine without shadow.
// Reference  metrics.lighting, ray casts
#include "pathtracing/state.glsl"
#include "pathtracing/light_sampling.glsl"
#include "pathtracing/camera_vertex.glsl"

uniform int rays_before; // of each pixel, in the dispatches before

void main() {
    ivec2 local = local_pixel();
    if (outside_tile(local)) return;
#if PIXEL_LIST
    if (list_entry(local).w == 0u) return;
#endif
    CameraVertex x = camera_vertex(local);
    Lobes sum = no_light();
    int next = 0; // of the lights around
    if (rays_before > 0) {
        next = int(load_state(local, EXACT(diffuse)).w);
#define LOAD_EXACT(lobe) sum.lobe = load_state(local, EXACT(lobe)).rgb;
        EACH_LOBE(LOAD_EXACT)
    }
    // Lanes trace together: each looks for its next light first.
    ivec2 around = entries_of(0, cell_of(x.p));
    for (int ray = 0; x.lit && ray < LIGHT_CHUNK && next < around.y; ++ray) {
        LightRecord light;
        Incident arriving;
        bool shines = false;
        while (!shines && next < around.y) {
            light = light_record(entry_row(around.x + next++));
            arriving = incident(light, x.p);
            shines = faces(x.surface, x.g, arriving.l) && luminance(arriving.radiance) > 0.0;
        }
        if (!shines) break;
        vec3 origin = offset_origin(x.p, x.g, arriving.l);
        float reach = punctual_reach(light, origin);
        if (occluded(Ray(origin, arriving.l, reach))) continue;
#if VOLUME
        arriving.radiance *= transmittance(medium_towards(x.surface, x.g, arriving.l), reach);
#endif
        sum = plus(sum, times(evaluate_brdf(x.surface, arriving.l), arriving.radiance));
    }
#define STORE_EXACT(lobe) store_state(local, EXACT(lobe), vec4(sum.lobe, float(next)));
    EACH_LOBE(STORE_EXACT)
}
