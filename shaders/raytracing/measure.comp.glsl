// One closest-hit ray at a sample of each pixel's hemisphere, and a shadow ray from there to a point: for measurements of
// the traversal, as a path tracer's bounce without its shading.
//
// Reads   position, geometric_normal (camera-relative); INDEPENDENT: random numbers per pixel instead of the same in all
// Writes  measured: x: distance, y: 1 where the point is seen, z: draw + 1, w: rays

#include "common/random.glsl"
#include "raytracing/trace.glsl"

uniform int sample_number;
uniform vec4 light; // camera-relative

#if TRACE_ALPHA
#include "raytracing/alpha.glsl"
#endif

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, imageSize(measured_out)))) return;
    vec3 p = position_at(at).xyz, n = geometric_normal_at(at).xyz;
    if (dot(n, n) < 0.5) {
        imageStore(measured_out, at, vec4(0.0));
        return;
    }
    vec4 u = random4(INDEPENDENT != 0 ? at : ivec2(0), 0u, 0u, uint(sample_number));
    float height = 1.0 - 2.0 * u.x, angle = 6.2831853 * u.y, radius = sqrt(max(1.0 - height * height, 0.0));
    vec3 d = n + 0.999 * vec3(radius * cos(angle), radius * sin(angle), height); // cosine-distributed
    Ray ray = Ray(offset_origin(p, n, n), normalize(d), 1e30);
    Hit hit = closest_hit(ray);
    bool met = hit.instance >= 0;
    vec3 there = met ? ray.origin + (hit.t * 0.9999) * ray.direction : ray.origin;
    vec3 to_light = light.xyz - there;
    bool dark = occluded(Ray(there, normalize(to_light), length(to_light)));
    imageStore(measured_out, at, vec4(hit.t, dark ? 0.0 : 1.0, float(hit.instance + 1), 2.0));
}
