// Light of lobes: checked, and added to the sums of a pixel.
#include "pathtracing/state.glsl"

Lobes finite_or_counted(Lobes x) {
    x.diffuse = finite_or_counted(x.diffuse);
    x.glossy = finite_or_counted(x.glossy);
#if TRANSMISSION
    x.transmission = finite_or_counted(x.transmission);
#endif
    return x;
}

Lobes over(Lobes x, float pdf) {
    x.diffuse /= pdf;
    x.glossy /= pdf;
#if TRANSMISSION
    x.transmission /= pdf;
#endif
    return x;
}

void add_direct(ivec2 local, Lobes x) {
    add_state(local, DIRECT_DIFFUSE, vec4(x.diffuse, 0.0));
    add_state(local, DIRECT_GLOSSY, vec4(x.glossy, 0.0));
#if TRANSMISSION
    add_state(local, DIRECT_TRANSMISSION, vec4(x.transmission, 0.0));
#endif
}

void add_indirect(ivec2 local, Lobes x) {
    add_state(local, INDIRECT_DIFFUSE, vec4(x.diffuse, 0.0));
    add_state(local, INDIRECT_GLOSSY, vec4(x.glossy, 0.0));
#if TRANSMISSION
    add_state(local, INDIRECT_TRANSMISSION, vec4(x.transmission, 0.0));
#endif
}

// What the visible surface sends to the camera of light that the path carries, by lobe.
Lobes first_lobes(ivec2 local, vec3 light) {
    Lobes x = no_light();
    x.diffuse = light * load_state(local, FIRST_DIFFUSE).rgb;
    x.glossy = light * load_state(local, FIRST_GLOSSY).rgb;
#if TRANSMISSION
    x.transmission = light * load_state(local, FIRST_TRANSMISSION).rgb;
#endif
    return x;
}
