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
#else
float fold(float x) { return 1.0 - abs(mod(x, 2.0) - 1.0); }

// Gradients are taken of the varying, before folding: a mirrored seam must not look like a jump to the mip selection.
vec4 sample_map(sampler2D map, MaterialRecord m, int slot) {
    vec4 row_x = m.uv_x[slot], row_y = m.uv_y[slot];
    vec2 raw = row_x.w < 0.5 ? texcoord.xy : texcoord.zw;
    mat2 uv_from_raw = mat2(row_x.x, row_y.x, row_x.y, row_y.y);
    vec2 uv = uv_from_raw * raw + vec2(row_x.z, row_y.z);
    int mirrored = int(row_y.w);
    if ((mirrored & 1) != 0) uv.x = fold(uv.x);
    if ((mirrored & 2) != 0) uv.y = fold(uv.y);
    return textureGrad(map, uv, uv_from_raw * dFdx(raw), uv_from_raw * dFdy(raw));
}
#endif
#endif
