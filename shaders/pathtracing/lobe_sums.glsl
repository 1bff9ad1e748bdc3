// Light of lobes: checked, and added to the sums of a pixel.
#include "common/lobes.glsl"
#include "pathtracing/state.glsl"

Lobes finite_or_counted(Lobes x) {
#define CHECK_LOBE(lobe) x.lobe = finite_or_counted(x.lobe);
    EACH_LOBE(CHECK_LOBE)
    return x;
}

Lobes over(Lobes x, float pdf) {
#define OVER_PDF(lobe) x.lobe /= pdf;
    EACH_LOBE(OVER_PDF)
    return x;
}

void add_direct(ivec2 local, Lobes x) {
#define ADD_DIRECT(lobe) add_state(local, DIRECT(lobe), vec4(x.lobe, 0.0));
    EACH_LOBE(ADD_DIRECT)
}

void add_indirect(ivec2 local, Lobes x) {
#define ADD_INDIRECT(lobe) add_state(local, INDIRECT(lobe), vec4(x.lobe, 0.0));
    EACH_LOBE(ADD_INDIRECT)
}

// What the visible surface sends to the camera of light that the path carries, by lobe.
Lobes first_lobes(ivec2 local, vec3 light) {
    Lobes x;
#define CARRIED_LIGHT(lobe) x.lobe = light * load_state(local, FIRST(lobe)).rgb;
    EACH_LOBE(CARRIED_LIGHT)
    return x;
}
