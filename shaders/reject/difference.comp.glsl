// What a rejection test compares with its threshold, for every pixel whose history is inside the previous image.
//
// Reads      position prev_position normal geometric_normal ids motion mask, history_<position normal ids motion>; radiance.
// Writes     difference: at least 0; infinite where only one of both is a surface; -1 where nothing is compared
// Needs      reject/contract.glsl, then float difference(Point now, Point history, Pixel pixel): test.glsl
// Reference  references.rejection

ivec2 inside(ivec2 at) { return clamp(at, ivec2(0), R.size.xy - 1); }
bool is_surface(ivec2 at) { return position_at(at).w > 0.0; }
float then_depth(ivec2 at) { return dot(R.prev_forward.xyz, prev_position_at(at).xyz); }
vec3 normal_of(ivec2 at) { return normal_at(at).xyz; }
#include "reject/neighbors.glsl"

#if COLOR
vec3 radiance_at_pixel(ivec2 at) {
    at = inside(at);
    vec3 sum = vec3(0.0);
#if HAS_DIRECT
    sum += direct_at(at).xyz;
#endif
#if HAS_INDIRECT
    sum += indirect_at(at).xyz;
#endif
    return sum * R.exposure;
}

vec3 history_radiance(ivec2 at) {
    vec3 sum = vec3(0.0);
#if HAS_DIRECT
    sum += history_direct_at(at).xyz;
#endif
#if HAS_INDIRECT
    sum += history_indirect_at(at).xyz;
#endif
    return sum * R.exposure;
}
#endif

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, R.size.xy))) return;
    float value = -1.0;
    bool surface = is_surface(at);
    if ((mask_at(at).x & NOT_COMPARED) == 0u) {
        Pixel pixel;
        pixel.at = at;
        pixel.history_at = vec2(at) + motion_at(at).xy;
        ivec2 there = inside(ivec2(floor(pixel.history_at + 0.5)));
        vec4 then = history_position_at(there);
        if (surface && then.w > 0.0) {
            Point now, history;
            now.position = prev_position_at(at).xyz;
            now.depth = then_depth(at);
            now.normal = normal_at(at).xyz;
            now.facing = normalize(geometric_normal_at(at).xyz);
            now.object = ids_at(at).x;
            now.motion = motion_at(at).xy;
            history.position = then.xyz;
            history.depth = then.w;
            history.normal = history_normal_at(there).xyz;
            history.facing = normalize(history_geometric_normal_at(there).xyz);
            history.object = history_ids_at(there).x;
            history.motion = history_motion_at(there).xy;
#if COLOR
            now.radiance = radiance_at_pixel(at);
            history.radiance = history_radiance(there);
#endif
            pixel.depth_gradient = vec2(slope(at, ivec2(1, 0), now.depth), slope(at, ivec2(0, 1), now.depth));
            pixel.normal_change = turn(at, ivec2(1, 0), now.normal) + turn(at, ivec2(0, 1), now.normal);
            pixel.footprint = R.footprint.x + R.footprint.y * now.depth;
            pixel.image_height = pixel.footprint * float(R.size.y);
            pixel.cosine = abs(dot(now.facing, position_at(at).xyz)) / max(length(position_at(at).xyz), 1e-30);
            value = difference(now, history, pixel);
        } else {
            value = surface != (then.w > 0.0) ? uintBitsToFloat(0x7f800000u) : -1.0;
        }
    }
    imageStore(difference_out, at, vec4(value));
}
