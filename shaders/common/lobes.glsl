// Light by lobe.
//
// EACH_LOBE(DO) is DO(name) for each lobe of a pass: the two that every lit scene has, and those of EACH_FURTHER_LOBE, which
// ``lobes.lobe_macros`` (taubench_gl/lobes.py) makes from the table of lobes.
#ifndef LOBE_COUNT
#define EACH_FURTHER_LOBE(DO)
#endif
#define EACH_LOBE(DO) DO(diffuse) DO(glossy) EACH_FURTHER_LOBE(DO)

#define LOBE_FIELD(lobe) vec3 lobe;
struct Lobes { EACH_LOBE(LOBE_FIELD) };

Lobes no_light() {
    Lobes x;
#define NO_LIGHT_IN(lobe) x.lobe = vec3(0.0);
    EACH_LOBE(NO_LIGHT_IN)
    return x;
}

#define PLUS_LOBE(lobe) + x.lobe
vec3 all_lobes(Lobes x) { return EACH_LOBE(PLUS_LOBE); }

Lobes times(Lobes x, vec3 light) {
#define TIMES_LIGHT(lobe) x.lobe *= light;
    EACH_LOBE(TIMES_LIGHT)
    return x;
}

Lobes plus(Lobes a, Lobes b) {
#define PLUS_OTHER(lobe) a.lobe += b.lobe;
    EACH_LOBE(PLUS_OTHER)
    return a;
}
