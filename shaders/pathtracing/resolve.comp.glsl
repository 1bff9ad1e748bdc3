// Means over the samples of each pixel of a tile, to the channels.
//
// Paper      section 3.2, f_dir and f_ind.
// Reads      path state.
// Writes     direct and indirect (added to the raster method's where both light the frame) and, where requested, each lobe
//            and path_info; with PIXEL_LIST instead the lobes of each entry.  Closes the last sample.
// Reference  references.path_tracing
#include "common/lobes.glsl"
#include "pathtracing/sums.glsl"

uniform int sample_count;

#define STORE(target, at, value) imageStore(target, at, vec4(value, 1.0))
#define ADD(target, at, value) imageStore(target, at, vec4(imageLoad(target, at).rgb + (value), 1.0))
#if ADD_TO_DIRECT
#define FINAL_DIRECT ADD
#else
#define FINAL_DIRECT STORE
#endif
#if ADD_TO_INDIRECT
#define FINAL_INDIRECT ADD
#else
#define FINAL_INDIRECT STORE
#endif

void main() {
    ivec2 local = local_pixel();
    if (outside_tile(local)) return;
    ivec2 pixel = pixel_of(local);
    float n = float(sample_count);
    close_sample(local, n);
    Lobes direct, indirect;
#define MEAN(lobe) \
    direct.lobe = load_state(local, DIRECT(lobe)).rgb / n; \
    indirect.lobe = load_state(local, INDIRECT(lobe)).rgb / n;
    EACH_LOBE(MEAN)
#if PIXEL_LIST
    int entry = 3 * LOBE_COUNT * (local.y * TILE_SIZE.x + local.x);
    bool exact = P.lights.y != 0 && list_entry(local).w != 0u;
#define LIST(lobe) \
    listed_light[entry + LOBE_##lobe] = vec4(direct.lobe, 1.0); \
    listed_light[entry + LOBE_COUNT + LOBE_##lobe] = vec4(indirect.lobe, 1.0); \
    listed_light[entry + 2 * LOBE_COUNT + LOBE_##lobe] = exact ? load_state(local, EXACT(lobe)) : vec4(0.0);
    EACH_LOBE(LIST)
#else
#if EXACT_PUNCTUAL
#define ADD_EXACT(lobe) direct.lobe += load_state(local, EXACT(lobe)).rgb;
    if (P.lights.y != 0) {
        EACH_LOBE(ADD_EXACT)
    }
#endif
    vec3 all_indirect = (load_state(local, INDIRECT(diffuse)).rgb + load_state(local, INDIRECT(glossy)).rgb) / n;
#define ADD_INDIRECT(lobe) all_indirect += indirect.lobe;
    EACH_FURTHER_LOBE(ADD_INDIRECT)
    FINAL_DIRECT(direct_out, pixel, all_lobes(direct));
    FINAL_INDIRECT(indirect_out, pixel, all_indirect);
#if SPLIT_DIRECT
#define WRITE_DIRECT(lobe) FINAL_DIRECT(direct_##lobe##_out, pixel, direct.lobe);
    EACH_LOBE(WRITE_DIRECT)
#endif
#if SPLIT_INDIRECT
#define WRITE_INDIRECT(lobe) FINAL_INDIRECT(indirect_##lobe##_out, pixel, indirect.lobe);
    EACH_LOBE(WRITE_INDIRECT)
#endif
#if PATH_INFO
    float squares = max(n * (n - 1.0), 1.0); // variance of the mean
    float meters = load_state(local, DIRECT(glossy)).w, hits = load_state(local, INDIRECT(glossy)).w;
    imageStore(path_info_out, pixel, vec4(hits > 0.0 ? meters / hits : 0.0, n, load_state(local, DIRECT(diffuse)).w / squares,
                                          load_state(local, INDIRECT(diffuse)).w / squares));
#endif
#endif
}
