// Running mean of light: mean + weight (sample - mean), of direct and indirect radiance.

uniform sampler2D sample_direct;
uniform sampler2D sample_indirect;
uniform sampler2D mean_direct;
uniform sampler2D mean_indirect;
uniform float weight; // 1 / number of samples; 1: the mean is not read
layout(location = 0) out vec4 direct;
layout(location = 1) out vec4 indirect;

vec4 average(sampler2D samples, sampler2D means) {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 one = texelFetch(samples, at, 0);
    if (weight >= 1.0) return one;
    vec4 mean = texelFetch(means, at, 0);
    return mean + weight * (one - mean);
}

void main() {
    direct = average(sample_direct, mean_direct);
    indirect = average(sample_indirect, mean_indirect);
}
