// Direct light of punctual lights at the pixels of a tile, every light with a shadow ray: no noise.
//
// Paper      section 3.2, f_dir.
// Reads      position normal geometric_normal base_color material, light table, acceleration structure.
// Writes     layers EXACT_DIFFUSE and EXACT_GLOSSY of the path state; lights first_light .. first_light + LIGHT_CHUNK - 1.
// Reference  metrics.lighting, ray casts
#include "pathtracing/state.glsl"
#include "pathtracing/light_sampling.glsl"
#include "pathtracing/camera_vertex.glsl"

uniform int first_light;

void main() {
    ivec2 local = local_pixel();
    if (outside_tile(local)) return;
    CameraVertex x = camera_vertex(local);
    Lobes sum = Lobes(vec3(0.0), vec3(0.0));
    if (x.lit) {
        int end = min(first_light + LIGHT_CHUNK, P.lights.x);
        for (int row = first_light; row < end; ++row) {
            LightRecord light = light_record(row);
            Incident arriving = incident(light, x.p);
            if (!faces(x.surface, x.g, arriving.l) || !(luminance(arriving.radiance) > 0.0)) continue;
            vec3 origin = offset_origin(x.p, x.g, arriving.l);
            if (occluded(Ray(origin, arriving.l, punctual_reach(light, origin)))) continue;
            Lobes f = evaluate_brdf(x.surface, arriving.l);
            sum.diffuse += f.diffuse * arriving.radiance;
            sum.glossy += f.glossy * arriving.radiance;
        }
    }
    if (first_light > 0) {
        sum.diffuse += load_state(local, EXACT_DIFFUSE).rgb;
        sum.glossy += load_state(local, EXACT_GLOSSY).rgb;
    }
    store_state(local, EXACT_DIFFUSE, vec4(sum.diffuse, 0.0));
    store_state(local, EXACT_GLOSSY, vec4(sum.glossy, 0.0));
}
