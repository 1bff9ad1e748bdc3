// Reflective shadow maps (Dachsbacher and Stamminger 2005): every texel that a light sees becomes a diffuse VPL.
//
// Reads      the lights' G-buffer (position relative to the current camera, normal, base color, material), light table.
// Writes     VPLs in scene space: flux reflected by the texel's patch = irradiance * area * albedo.  With PROBES also the
//            share of this VPL in its patch: lights that see the same surface all have VPLs on it.
#include "common/affine.glsl"
#include "common/vpl.glsl"
#include "common/lights.glsl"

#if PROBES
#include "common/voxels.glsl"
#include "common/light_share.glsl"
#endif

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(P.counts.w)) return;
    uvec4 t = texels[i];
    ivec2 at = ivec2(t.xy);
    VirtualPointLight v;
    v.position = v.normal = v.flux = v.albedo = vec4(0.0);
    vec4 p = position_at(at);
    vec4 normal_and_hit = normal_at(at);
    if (normal_and_hit.w > 0.0) { // position.w is depth along the light's axis, but from the camera: of either sign
        ShadowFace face = faces[t.z];
        int row = int(face.extent.w);
        LightRecord light = light_record(row);
        Incident incoming = incident(light, p.xyz);
        vec3 n = normal_and_hit.xyz;
        if (dot(n, incoming.l) < 0.0) n = -n; // the side the light sees
        float n_l = dot(n, incoming.l);
        float size = face.extent.y;
        // Area of the surface patch behind the texel: across the ray, then slanted.
        float across = size * size;
        if (face.origin.w < 0.5) {
            vec3 q = p.xyz - face.origin.xyz;
            float z = dot(face.forward.xyz, q);
            across *= z * z * z / length(q); // projected texel, turned across the ray
        }
        vec4 base = base_color_at(at);
        vec4 m = material_at(at);
        v.albedo.rgb = m.w < 0.0 ? vec3(0.0) : base.rgb * (1.0 - 0.04 * m.w);
        v.position = vec4(p.xyz + P.scene_from_relative.xyz, across / max(n_l, 0.05));
        // Visibility rays aim this far above the patch, but never past the light that found it: a bulb smaller than a
        // voxel must keep its light.  Less than VPL_LIFT voxels: beside its light (visibility.comp).
        float reach = light.direction.w == KIND_DIRECTIONAL ? 3.0e38 : 0.5 * distance(light.position.xyz, p.xyz);
        v.normal = vec4(n, min(VPL_LIFT * P.grid_origin.w, reach));
        v.flux = vec4(incoming.radiance * across * v.albedo.rgb, 0.0);
        v.albedo.w = 1.0;
#if PROBES
        float slack = v.normal.w > P.grid_origin.w ? 0.5 : 0.0;
        vec3 aim = v.position.xyz + v.normal.w * n;
        v.albedo.w = 1.0 / float(1 + lights_that_see(p.xyz, n, aim, slack, row));
#endif
    }
    ivec2 record = vpl_texel(int(i));
    imageStore(vpl_out, record, v.position);
    imageStore(vpl_out, record + ivec2(1, 0), v.normal);
    imageStore(vpl_out, record + ivec2(2, 0), v.flux);
    imageStore(vpl_out, record + ivec2(3, 0), v.albedo);
}
