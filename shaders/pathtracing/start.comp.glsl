// The first vertex of a sample of each pixel of a tile: light that arrives there directly, and the direction of the path.
//
// Paper      section 3.2, f_dir.
// Reads      position normal geometric_normal base_color material, lights, acceleration structure.
// Writes     path state, paths that go on.  Closes the sample before, and empties the lists of the next.
// Reference  references.path_tracing
#include "pathtracing/light_sampling.glsl"
#include "pathtracing/going_on.glsl"
#include "pathtracing/numbers.glsl"
#include "pathtracing/sums.glsl"
#include "pathtracing/lobe_sums.glsl"
#include "pathtracing/camera_vertex.glsl"

uniform int samples_before; // samples of this pixel that are in the sums

void main() {
    ivec2 local = local_pixel();
    if (local == ivec2(0)) empty_lists(1 - odd_sample);
    if (outside_tile(local)) return;
    NumbersOf numbers = numbers_of(local);
    if (samples_before == 0) {
        for (int layer = DIRECT(diffuse); layer < EXACT(diffuse); ++layer) store_state(local, layer, vec4(0.0));
    } else {
        close_sample(local, float(samples_before));
    }
    CameraVertex x = camera_vertex(local);
    Lobes direct = no_light(), first = direct, connected = direct;
    int cell = cell_of(x.p);
    if (x.lit) {
        direct = next_event(x.surface, x.p, x.g, cell, sample_numbers_of(numbers, 0, EMITTER),
                            sample_numbers_of(numbers, 0, ENVIRONMENT_PUNCTUAL), P.lights.y, vec2(0.0));
        direct = finite_or_counted(direct);
        BrdfSample next = sample_brdf(x.surface, sample_numbers_of(numbers, 0, SCATTER).xyz);
        if (next.pdf > 0.0 && faces(x.surface, x.g, next.l)) {
            first = evaluate_brdf(x.surface, next.l);
            first = finite_or_counted(over(first, next.pdf));
            store_state(local, ORIGIN_PDF, vec4(offset_origin(x.p, x.g, next.l), next.pdf));
#if VOLUME
            store_state(local, DIRECTION, vec4(next.l, medium_towards(x.surface, x.g, next.l)));
#else
            store_state(local, DIRECTION, vec4(next.l, 0.0));
#endif
            if (luminance(all_lobes(first)) > 0.0) go_on(local, 1);
        }
#if BIDIRECTIONAL
        connected = connect(local, x.surface, x.p, x.g);
        connected = finite_or_counted(connected);
        add_indirect(local, connected);
#endif
        add_direct(local, direct);
    }
    store_state(local, THROUGHPUT, vec4(vec3(1.0), float(cell)));
    store_state(local, FIRST(diffuse), vec4(first.diffuse, luminance(all_lobes(direct))));
    store_state(local, FIRST(glossy), vec4(first.glossy, luminance(all_lobes(connected))));
#define STORE_FIRST(lobe) store_state(local, FIRST(lobe), vec4(first.lobe, 0.0));
    EACH_FURTHER_LOBE(STORE_FIRST)
}
