// The surface of a pixel, as the rasterizer found it: the first vertex of its paths.
#include "common/to_camera.glsl"

struct CameraVertex {
    bool lit; // a surface that scatters light
    vec3 p;   // relative to the camera
    vec3 g;   // unit normal of the triangle, facing the viewer
    Surface surface;
};

CameraVertex camera_vertex(ivec2 local) {
    CameraVertex r;
    ivec2 pixel = pixel_of(local);
    vec4 p = position_at(pixel), m = material_at(pixel);
    r.lit = p.w > 0.0 && m.w >= 0.0;
    r.p = load_state(local, FIRST_POINT).xyz;
    r.g = safe_normalize(geometric_normal_at(pixel).xyz);
    r.surface.base_color = base_color_at(pixel).rgb;
    r.surface.metallic = m.x;
    r.surface.alpha = max(m.y * m.y, MIN_ALPHA);
    r.surface.specular = m.w;
    r.surface.n = normal_at(pixel).xyz;
    r.surface.v = direction_to_camera(pixel, p.xyz);
#if DIELECTRICS
    vec4 lobe = load_state(local, FIRST_F0);
    r.surface.f0 = lobe.rgb;
    r.surface.specular = lobe.w;
#endif
#if TRANSMISSION
    vec4 glass = load_state(local, FIRST_GLASS);
    r.surface.transmission = glass.x;
    r.surface.eta = glass.y;
    r.surface.thick = glass.z > 0.5;
#endif
#if VOLUME
    r.surface.medium = max(-glass.w, 0.0); // the camera is in air: what is before the surface absorbs nothing on the way to it
    r.surface.beyond = max(glass.w, 0.0);
#endif
    return r;
}
