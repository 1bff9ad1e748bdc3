// Directional albedos of the lobes, from a table.   Reference: metrics.lighting.albedo_table

// Light of a uniform environment that the lobes send to the viewer: glossy F0 x + F90 y, diffuse 1 - Fresnel with z for Schlick's term.
vec3 lobe_albedos(float roughness, float n_v) {
    vec2 at = clamp(vec2(n_v, roughness), 0.0, 1.0) * float(textureSize(albedo_table, 0).x - 1);
    ivec2 base = min(ivec2(at), textureSize(albedo_table, 0) - 2);
    vec2 f = at - vec2(base);
    vec3 low = mix(albedo_table_at(base).xyz, albedo_table_at(base + ivec2(1, 0)).xyz, f.x);
    base.y += 1;
    vec3 high = mix(albedo_table_at(base).xyz, albedo_table_at(base + ivec2(1, 0)).xyz, f.x);
    return mix(low, high, f.y);
}

// Albedo of the glossy lobe alone: dielectric and metal, mixed by ``metallic``.
vec3 glossy_albedo(vec3 base_color, float metallic, float specular, vec3 table) {
    float dielectric = specular * (0.04 * table.x + table.y);
    return (1.0 - metallic) * dielectric + metallic * (base_color * table.x + table.y);
}
