// Sums over the samples of a pixel.
#include "pathtracing/state.glsl"

// Add the squared deviation of one sample's luminance: Welford's update.  ``sum``: luminance of all samples, this one too.
float added_deviation(float squares, float sum, float last, float count) {
    if (count < 2.0) return 0.0;
    float deviation = last - (sum - last) / (count - 1.0);
    return squares + deviation * deviation * (count - 1.0) / count;
}

vec3 direct_sum(ivec2 local) {
    vec3 sum = load_state(local, DIRECT_DIFFUSE).rgb + load_state(local, DIRECT_GLOSSY).rgb;
#if TRANSMISSION
    sum += load_state(local, DIRECT_TRANSMISSION).rgb;
#endif
    return sum;
}

vec3 indirect_sum(ivec2 local) {
    vec3 sum = load_state(local, INDIRECT_DIFFUSE).rgb + load_state(local, INDIRECT_GLOSSY).rgb;
#if TRANSMISSION
    sum += load_state(local, INDIRECT_TRANSMISSION).rgb;
#endif
    return sum;
}

// Close the sample that FIRST_DIFFUSE.w and FIRST_GLOSSY.w hold; ``count``: samples with it.
void close_sample(ivec2 local, float count) {
    vec4 diffuse = load_state(local, DIRECT_DIFFUSE);
    diffuse.w = added_deviation(diffuse.w, luminance(direct_sum(local)),
                                load_state(local, FIRST_DIFFUSE).w, count);
    store_state(local, DIRECT_DIFFUSE, diffuse);
    diffuse = load_state(local, INDIRECT_DIFFUSE);
    diffuse.w = added_deviation(diffuse.w, luminance(indirect_sum(local)),
                                load_state(local, FIRST_GLOSSY).w, count);
    store_state(local, INDIRECT_DIFFUSE, diffuse);
}
