// Light that is left after a way through the medium of a path.   Reference: references.dielectric
#if VOLUME
// ``medium``: place of a material among the tables of hits, 0: none.  Beer and Lambert.
vec3 transmittance(float medium, float meters) {
    if (!(medium > 0.0)) return vec3(1.0);
    return exp(-meters * hit_floats(uint(medium) + HIT_MATERIAL_TEXELS - 1u).rgb);
}
#endif
