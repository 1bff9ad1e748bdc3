// Means over the samples of each pixel of a tile, to the channels.
//
// Paper      section 3.2, f_dir and f_ind.
// Reads      path state.
// Writes     direct and indirect (added to the raster method's where both light the frame) and, where requested, each lobe
//            and path_info; with PIXEL_LIST instead the lobes of each entry.  Closes the last sample.
// Reference  references.path_tracing
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
    vec4 direct_diffuse = load_state(local, DIRECT_DIFFUSE), direct_glossy = load_state(local, DIRECT_GLOSSY);
    vec4 indirect_diffuse = load_state(local, INDIRECT_DIFFUSE), indirect_glossy = load_state(local, INDIRECT_GLOSSY);
    vec3 diffuse = direct_diffuse.rgb / n, glossy = direct_glossy.rgb / n;
#if TRANSMISSION
    vec3 through = load_state(local, DIRECT_TRANSMISSION).rgb / n;
    vec3 indirect_through = load_state(local, INDIRECT_TRANSMISSION).rgb / n;
#endif
#if PIXEL_LIST
    const int LOBES = LISTED_LOBES / 3;
    int entry = LISTED_LOBES * (local.y * TILE_SIZE.x + local.x);
    listed_light[entry] = vec4(diffuse, 1.0);
    listed_light[entry + 1] = vec4(glossy, 1.0);
    listed_light[entry + LOBES] = vec4(indirect_diffuse.rgb / n, 1.0);
    listed_light[entry + LOBES + 1] = vec4(indirect_glossy.rgb / n, 1.0);
    bool exact = EXACT_PUNCTUAL != 0 && list_entry(local).w != 0u;
    listed_light[entry + 2 * LOBES] = exact ? load_state(local, EXACT_DIFFUSE) : vec4(0.0);
    listed_light[entry + 2 * LOBES + 1] = exact ? load_state(local, EXACT_GLOSSY) : vec4(0.0);
#if TRANSMISSION
    listed_light[entry + 2] = vec4(through, 1.0);
    listed_light[entry + LOBES + 2] = vec4(indirect_through, 1.0);
    listed_light[entry + 2 * LOBES + 2] = exact ? load_state(local, EXACT_TRANSMISSION) : vec4(0.0);
#endif
#else
#if EXACT_PUNCTUAL
    diffuse += load_state(local, EXACT_DIFFUSE).rgb;
    glossy += load_state(local, EXACT_GLOSSY).rgb;
#endif
    vec3 direct = diffuse + glossy, indirect = (indirect_diffuse.rgb + indirect_glossy.rgb) / n;
#if TRANSMISSION
#if EXACT_PUNCTUAL
    through += load_state(local, EXACT_TRANSMISSION).rgb;
#endif
    direct += through;
    indirect += indirect_through;
#endif
    FINAL_DIRECT(direct_out, pixel, direct);
    FINAL_INDIRECT(indirect_out, pixel, indirect);
#if SPLIT_DIRECT
    FINAL_DIRECT(direct_diffuse_out, pixel, diffuse);
    FINAL_DIRECT(direct_glossy_out, pixel, glossy);
#if TRANSMISSION
    FINAL_DIRECT(direct_transmission_out, pixel, through);
#endif
#endif
#if SPLIT_INDIRECT
    FINAL_INDIRECT(indirect_diffuse_out, pixel, indirect_diffuse.rgb / n);
    FINAL_INDIRECT(indirect_glossy_out, pixel, indirect_glossy.rgb / n);
#if TRANSMISSION
    FINAL_INDIRECT(indirect_transmission_out, pixel, indirect_through);
#endif
#endif
#if PATH_INFO
    float squares = max(n * (n - 1.0), 1.0); // variance of the mean
    imageStore(path_info_out, pixel, vec4(indirect_glossy.w > 0.0 ? direct_glossy.w / indirect_glossy.w : 0.0, n,
                                          direct_diffuse.w / squares, indirect_diffuse.w / squares));
#endif
#endif
}
