// The material of the group being drawn, and texture sampling with KHR_texture_transform and mirrored wrapping.
#if TEXCOORDS
in vec4 texcoord;
#endif
#if TEXCOORDS
#if PLAIN_UV
// Every texture of the material lies on the first coordinates as they are, which is what most files have.
vec4 sample_map(sampler2D map, MaterialRecord m, int slot) {
    return textureGrad(map, texcoord.xy, dFdx(texcoord.xy), dFdy(texcoord.xy));
}

vec4 finest_of_map(sampler2D map, MaterialRecord m, int slot) { return textureLod(map, texcoord.xy, 0.0); }
#else
float fold(float x) { return 1.0 - abs(mod(x, 2.0) - 1.0); }

vec2 map_uv(MaterialRecord m, int slot, vec2 raw, mat2 uv_from_raw) {
    vec2 uv = uv_from_raw * raw + vec2(m.uv_x[slot].z, m.uv_y[slot].z);
    int mirrored = int(m.uv_y[slot].w);
    if ((mirrored & 1) != 0) uv.x = fold(uv.x);
    if ((mirrored & 2) != 0) uv.y = fold(uv.y);
    return uv;
}

mat2 uv_matrix(MaterialRecord m, int slot) {
    vec4 row_x = m.uv_x[slot], row_y = m.uv_y[slot];
    return mat2(row_x.x, row_y.x, row_x.y, row_y.y);
}

vec2 raw_uv(MaterialRecord m, int slot) { return m.uv_x[slot].w < 0.5 ? texcoord.xy : texcoord.zw; }

// Gradients are taken of the varying, before folding: a mirrored seam must not look like a jump to the mip selection.
vec4 sample_map(sampler2D map, MaterialRecord m, int slot) {
    vec2 raw = raw_uv(m, slot);
    mat2 uv_from_raw = uv_matrix(m, slot);
    return textureGrad(map, map_uv(m, slot, raw, uv_from_raw), uv_from_raw * dFdx(raw), uv_from_raw * dFdy(raw));
}

vec4 finest_of_map(sampler2D map, MaterialRecord m, int slot) {
    return textureLod(map, map_uv(m, slot, raw_uv(m, slot), uv_matrix(m, slot)), 0.0);
}
#endif

// Alpha that is compared with a cutoff is read at the finest level, as rays read it (raytracing/alpha.glsl).  The mean
// alpha of a coarser level is not the share of its texels above the cutoff: foliage would vanish with distance.  A random
// threshold keeps the mean, and takes alpha from the mipmaps.
// Departs    Castano 2010, "Computing Alpha Mipmaps", scales the alpha of each level to the coverage of the finest.  That
//            holds for one cutoff, a whole texture and a whole level: not for the parts of an atlas, not between levels.
float sample_alpha(sampler2D map, MaterialRecord m, int slot) {
#if STOCHASTIC_ALPHA
    return sample_map(map, m, slot).a;
#else
    return finest_of_map(map, m, slot).a;
#endif
}
#endif
