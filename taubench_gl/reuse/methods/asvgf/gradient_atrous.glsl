// One level of the reconstruction of the gradient: an a-trous filter over blocks, of gradient and normalization alike.
// Blocks without a sample have no weight and are filled by their neighbors.
//
// Paper    Schied, Peters, Dachsbacher 2018, gradient reconstruction: the edge stopping functions of SVGF, with the variance
//          of the luminance within a block.   Reference  references.reuse_methods.gradient_level
// Departs  Kernel and step are those of SVGF's filter.
#include "edges.glsl"

void reuse(ivec2 b) {
    const float kernel[3] = float[3](3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0);
    ivec2 count = (frame.size.xy + 2) / 3, p = min(3 * b + 1, frame.size.xy - 1);
    vec4 sum = vec4(0.0);
    if (all(lessThan(b, count))) {
        vec4 position = fetch_position(p);
        vec3 normal = fetch_normal(p).xyz;
        vec2 slope = depth_slope(p), own = fetch_blocks(b);
        for (int y = -2; y <= 2; ++y)
            for (int x = -2; x <= 2; ++x) {
                ivec2 c = b + (1 << iteration) * ivec2(x, y);
                if (any(lessThan(c, ivec2(0))) || any(greaterThanEqual(c, count))) continue;
                vec4 other = fetch_gradient(c);
                if (other.z <= 0.0) continue;
                ivec2 q = min(3 * c + 1, frame.size.xy - 1);
                float w = kernel[abs(x)] * kernel[abs(y)] * luminance_weight(own.x, fetch_blocks(c).x, own.y)
                    * geometry_weight(position, fetch_position(q), normal, fetch_normal(q).xyz, slope, vec2(q - p));
                sum += w * vec4(other.xy / other.z, 1.0, 0.0);
            }
    }
    write_gradient(b, sum.z > 0.0 ? vec4(sum.xy / sum.z, 1.0, 0.0) : vec4(0.0));
}
