// The light subpath of a sample of each pixel of a tile: a surface point that a point or spot light shines on.
//
// Reads      light table, acceleration structure, attributes of hits.
// Writes     layers LIT_POINT .. LIT_COLOR of the path state.
// Reference  references.path_tracing
#include "raytracing/surface.glsl"
#include "pathtracing/light_sampling.glsl"
#include "pathtracing/hit_vertex.glsl"
#include "pathtracing/numbers.glsl"

void main() {
    ivec2 local = local_pixel();
    if (outside_tile(local)) return;
    vec4 u = sample_numbers_of(numbers_of(local), SUBPATH_VERTEX, SCATTER);
    SubpathEnd y;
    y.row = choose_light(u.x, P.lights.x);
    LightRecord light = light_record(y.row);
    float cosine = mix(1.0, least_cosine(light), u.y), sine = sqrt(max(1.0 - cosine * cosine, 0.0)), around = 2.0 * PI * u.z;
    vec3 direction = normalize(basis_around(light.direction.xyz) * vec3(sine * cos(around), sine * sin(around), cosine));
    // As shadow rays, which end just before the light: a light on a surface is not behind it.
    vec3 size = abs(light.position.xyz);
    Ray ray = Ray(light.position.xyz + LIGHT_GAP * max(size.x, max(size.y, size.z)) * direction, direction, FAR);
    Hit hit = Hit(FAR, -1, -1, vec2(0.0));
    if (subpath_choice(y.row) > 0.0) hit = closest_hit(ray);
    if (hit.instance < 0) {
        y.row = -1;
    } else {
        HitSurface x = surface_at(ray, hit, u.w);
        if (x.unlit) y.row = -1;
        y.p = x.position;
        y.g = x.geometric_normal;
        y.surface = hit_vertex(x, vec3(0.0), 0.0);
#if TRANSMISSION
        if (y.surface.transmission > 0.0) y.row = -1; // pairs with such a point are found from the camera alone
#endif
    }
    store_subpath(local, y);
}
