// Shadow pass, fragments: depth, without what an alpha mask cuts out.
#include "common/material.glsl"
#include "common/stochastic_alpha.glsl"

in vec3 pos_rel;
flat in uvec4 ids;
#if COLORS
in vec4 vertex_color;
#endif

void main() {
#if ALPHA_TEST
    MaterialRecord m = material;
    float alpha = m.base_color.a;
#if BASE_COLOR_MAP
    alpha *= sample_alpha(base_color_map, m, SLOT_BASE_COLOR);
#endif
#if COLORS
    alpha *= vertex_color.a;
#endif
#if STOCHASTIC_ALPHA
    if (alpha < alpha_threshold(ids.x)) discard;
#else
    if (alpha < m.alpha_cutoff.x) discard;
#endif
#endif
}
