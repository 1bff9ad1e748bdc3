// Where shadow rays end.
// Needs      LIGHT_GAP and common/lights.glsl where PUNCTUAL
const float FAR = 1.0e30; // meters: longer than any ray within a scene

#if PUNCTUAL
// To a point or spot light the ray ends just before it, where a light on a surface is not behind that surface.
float punctual_reach(LightRecord light, vec3 p) {
    if (light.direction.w == KIND_DIRECTIONAL) return FAR;
    vec3 a = abs(light.position.xyz), b = abs(p);
    float size = max(max(max(a.x, a.y), a.z), max(max(b.x, b.y), b.z));
    return max(length(light.position.xyz - p) - LIGHT_GAP * size, 0.0);
}
#endif
