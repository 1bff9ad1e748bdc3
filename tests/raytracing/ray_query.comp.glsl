// Answers rays from a texture, for tests of the traversal.
//
// Reads   ray_origins (xyz: origin, w: t_max), ray_directions, ray_normals (0: the origin is used as it is)
// Writes  hits (t, draw or -1, triangle), weights; with ANY_HIT only whether something was hit
// BEFORE  the surfaces as they were in the frame before

#include "raytracing/trace.glsl"

uniform int ray_count;

#if TRACE_ALPHA
#include "raytracing/alpha.glsl"
#endif

#if BEFORE
#define CLOSEST_HIT closest_hit_before
#define OCCLUDED occluded_before
#else
#define CLOSEST_HIT closest_hit
#define OCCLUDED occluded
#endif

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(hits_out);
    if (at.x >= size.x || at.y >= size.y || at.y * size.x + at.x >= ray_count) return;
    vec4 origin = ray_origins_at(at), direction = ray_directions_at(at);
    vec3 normal = ray_normals_at(at).xyz; // 0: the origin is not offset
    Ray ray = Ray(offset_origin(origin.xyz, normal, direction.xyz), direction.xyz, origin.w);
#if ANY_HIT
    uvec4 words = uvec4(0u, OCCLUDED(ray) ? 0u : 0xFFFFFFFFu, 0u, 0u);
    imageStore(hits_out, at, words);
#else
    Hit hit = CLOSEST_HIT(ray);
    imageStore(hits_out, at, uvec4(floatBitsToUint(hit.t), uint(hit.instance), uint(hit.triangle), 0u));
    imageStore(weights_out, at, vec4(hit.barycentrics, 0.0, 0.0));
#endif
}
