// Sums over the samples of a pixel.
#include "common/lobes.glsl"
#include "pathtracing/state.glsl"

// Add the squared deviation of one sample's luminance: Welford's update.  ``sum``: luminance of all samples, this one too.
float added_deviation(float squares, float sum, float last, float count) {
    if (count < 2.0) return 0.0;
    float deviation = last - (sum - last) / (count - 1.0);
    return squares + deviation * deviation * (count - 1.0) / count;
}

vec3 direct_sum(ivec2 local) {
#define PLUS_DIRECT(lobe) + load_state(local, DIRECT(lobe)).rgb
    return EACH_LOBE(PLUS_DIRECT);
}

vec3 indirect_sum(ivec2 local) {
#define PLUS_INDIRECT(lobe) + load_state(local, INDIRECT(lobe)).rgb
    return EACH_LOBE(PLUS_INDIRECT);
}

// Close the sample that FIRST(diffuse).w and FIRST(glossy).w hold; ``count``: samples with it.
void close_sample(ivec2 local, float count) {
    vec4 diffuse = load_state(local, DIRECT(diffuse));
    diffuse.w = added_deviation(diffuse.w, luminance(direct_sum(local)),
                                load_state(local, FIRST(diffuse)).w, count);
    store_state(local, DIRECT(diffuse), diffuse);
    diffuse = load_state(local, INDIRECT(diffuse));
    diffuse.w = added_deviation(diffuse.w, luminance(indirect_sum(local)),
                                load_state(local, FIRST(glossy)).w, count);
    store_state(local, INDIRECT(diffuse), diffuse);
}
