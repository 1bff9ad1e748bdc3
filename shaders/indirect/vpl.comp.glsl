// Reflective shadow maps (Dachsbacher and Stamminger 2005): every texel a light sees becomes a diffuse virtual light.
//
// Reads    the lights' own G-buffer (position relative to the current camera, normal, base colour, material).
// Writes   virtual lights in scene space: flux reflected by the texel's patch = irradiance * area * albedo.
#include "common/affine.glsl"
#include "common/lights.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Parameters { IndirectRecord P; };
layout(std430, binding = 1) readonly buffer Lights { LightRecord lights[]; };
layout(std430, binding = 2) writeonly buffer Virtual { VirtualLight virtual_lights[]; };
layout(std430, binding = 3) readonly buffer Texels { uvec4 texels[]; }; // x, y in the atlas; face; light row
layout(std430, binding = 5) readonly buffer Faces { ShadowFace faces[]; };

uniform sampler2D position;
uniform sampler2D normal;
uniform sampler2D base_color;
uniform sampler2D material;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(P.counts.x)) return;
    uvec4 t = texels[i];
    ivec2 at = ivec2(t.xy);
    VirtualLight v;
    v.position = v.normal = v.flux = v.albedo = vec4(0.0);
    vec4 p = texelFetch(position, at, 0);
    vec4 normal_and_hit = texelFetch(normal, at, 0);
    if (normal_and_hit.w > 0.0) { // position.w is depth along the light's axis, but from the camera: of either sign
        ShadowFace face = faces[t.z];
        LightRecord light = lights[t.w];
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
        vec4 base = texelFetch(base_color, at, 0);
        vec4 m = texelFetch(material, at, 0);
        v.albedo.rgb = m.w < 0.0 ? vec3(0.0) : base.rgb * (1.0 - 0.04 * m.w);
        v.position = vec4(p.xyz + P.scene_from_relative.xyz, across / max(n_l, 0.05));
        // Visibility rays aim this far above the patch, but never past the light that found it: a bulb smaller than a
        // voxel must keep its light.
        float reach = light.direction.w == KIND_DIRECTIONAL ? 3.0e38 : 0.5 * distance(light.position.xyz, p.xyz);
        v.normal = vec4(n, min(1.75 * P.grid_origin.w, reach));
        v.flux = vec4(incoming.radiance * across * v.albedo.rgb, 0.0);
    }
    virtual_lights[i] = v;
}
