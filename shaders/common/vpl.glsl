// Virtual point lights (VPLs), in scene space: world axes, meters from the center of the scene's bounds.  Scene space does
// not move with the camera, so a still scene keeps its indirect light bit for bit.
const float IRRADIANCE_PI = 3.14159265358979;

// Texel of the first field of VPL k: a field a texel, VPL_ROW VPLs in a row.
ivec2 vpl_texel(int k) { return ivec2(4u * (uint(k) % uint(VPL_ROW)), uint(k) / uint(VPL_ROW)); }

#ifdef vpls_at
VirtualPointLight vpl(int k) {
    ivec2 at = vpl_texel(k);
    return VirtualPointLight(vpls_at(at), vpls_at(at + ivec2(1, 0)), vpls_at(at + ivec2(2, 0)), vpls_at(at + ivec2(3, 0)));
}
#endif

// Irradiance at x, normal n, of a diffuse VPL: a disk with the area of its texel, so that the value stays bounded nearby
// (Keller 1997; the disk form is that of Wallace et al. 1989).
vec3 vpl_irradiance(VirtualPointLight v, vec3 x, vec3 n) {
    vec3 d = v.position.xyz - x;
    float d2 = dot(d, d);
    if (d2 <= 0.0) return vec3(0.0);
    vec3 l = d * inversesqrt(d2);
    float cosines = max(dot(n, l), 0.0) * max(-dot(v.normal.xyz, l), 0.0);
    return v.flux.rgb * cosines / (IRRADIANCE_PI * d2 + v.position.w);
}
