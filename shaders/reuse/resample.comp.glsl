// The result of a method at another size: bilinear between pixel centers in float32, which texture units are not.
//
// Reads     result
// Writes    resampled; a (the weight of history) from the nearest pixel, because -1 denotes that it is not reported
// Reference references.resampling
uniform ivec2 own_size, size; // pixels of the method's result; of the resampled one

vec4 at(ivec2 p) { return texelFetch(result, clamp(p, ivec2(0), own_size - 1), 0); }

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    vec2 from = (vec2(pixel) + 0.5) * vec2(own_size) / vec2(size) - 0.5;
    ivec2 b = ivec2(floor(from));
    vec2 f = from - floor(from);
    vec4 sum = mix(mix(at(b), at(b + ivec2(1, 0)), f.x), mix(at(b + ivec2(0, 1)), at(b + ivec2(1, 1)), f.x), f.y);
    imageStore(resampled_out, pixel, vec4(sum.rgb, at((2 * pixel + 1) * own_size / (2 * size)).a));
}
