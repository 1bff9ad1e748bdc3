// Virtual point lights and ambient-cube probes, in scene space: world axes, metres from the centre of the scene's bounds.
// Scene space does not move with the camera, so a still scene keeps its indirect light bit for bit.
const float IRRADIANCE_PI = 3.14159265358979;

// Records of a float image, a field a texel: image loads are made for all lanes at once where reads of storage buffers
// are not (Mesa's llvmpipe), and take half the time of a sampler's fetches.
layout(rgba32f, binding = 2) readonly uniform image2D virtual_lights;

ivec2 virtual_texel(int k) { return ivec2(4u * (uint(k) % uint(VIRTUAL_ROW)), uint(k) / uint(VIRTUAL_ROW)); }

VirtualLight virtual_light(int k) {
    ivec2 at = virtual_texel(k);
    return VirtualLight(imageLoad(virtual_lights, at), imageLoad(virtual_lights, at + ivec2(1, 0)),
                        imageLoad(virtual_lights, at + ivec2(2, 0)), imageLoad(virtual_lights, at + ivec2(3, 0)));
}

// Irradiance at x, normal n, of a diffuse virtual light: a disk of its own texel's area, so nothing blows up close by
// (Keller 1997; the disk form is that of Wallace et al. 1989).
vec3 vpl_irradiance(VirtualLight vpl, vec3 x, vec3 n) {
    vec3 d = vpl.position.xyz - x;
    float d2 = dot(d, d);
    if (d2 <= 0.0) return vec3(0.0);
    vec3 l = d * inversesqrt(d2);
    float cosines = max(dot(n, l), 0.0) * max(-dot(vpl.normal.xyz, l), 0.0);
    return vpl.flux.rgb * cosines / (IRRADIANCE_PI * d2 + vpl.position.w);
}
