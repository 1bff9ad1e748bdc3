// Both sides of every surface patch become VPLs with the light of the lights that have no reflective shadow maps.
//
// Reads      patches and these lights, in scene space; bricks of voxels.
// Writes     (adds to) VPLs from P.counts.w on: flux reflected by each side = irradiance * area * albedo.  With PROBES
//            lights are occluded through the occupancy grid, and later bounces are left to the VPLs of maps where there
//            are any on the same surface.
// Departs    A patch gets the irradiance of its center, softened so that a light right above gives half its power.
#include "common/affine.glsl"
#include "common/vpl.glsl"
#include "common/lights.glsl"

#if PROBES
#include "common/voxels.glsl"
#include "common/light_share.glsl"
#endif

// Lights [x, y) of this dispatch; later chunks add to the sums (tuning.PATCH_LIGHT_CHUNK).
uniform ivec2 chunk;

void main() {
    int i = int(gl_GlobalInvocationID.x);
    if (P.counts.w + i >= P.counts.x) return;
    PatchRecord patch_ = patches[i >> 1];
    ivec2 record = vpl_texel(P.counts.w + i);
    float area = patch_.position.w, voxel = P.grid_origin.w;
    vec3 x = patch_.position.xyz, n = (i & 1) == 0 ? patch_.normal.xyz : -patch_.normal.xyz;
    vec3 flux = vec3(0.0);
    float height = VPL_LIFT * voxel;
    if (chunk.x > 0) {
        flux = vpls_at(record + ivec2(2, 0)).rgb;
        height = vpls_at(record + ivec2(1, 0)).w;
    }
    for (int k = chunk.x; k < chunk.y && area > 0.0; ++k) {
        LightRecord light = patch_lights[k];
        Incident incoming = incident(light, x);
        float n_l = dot(n, incoming.l);
        float power = max(incoming.radiance.r, max(incoming.radiance.g, incoming.radiance.b));
        if (!(n_l > 0.0) || !(power > 0.0)) continue;
        float softened = 1.0;
        vec3 to_light = incoming.l * (2.0 * float(GRID) * voxel);
        float lift = VPL_LIFT * voxel;
        if (light.direction.w != KIND_DIRECTIONAL) {
            to_light = light.position.xyz - x;
            float d2 = max(dot(to_light, to_light), MIN_LIGHT_DISTANCE * MIN_LIGHT_DISTANCE);
            if (light.spot.w == 0.0) softened = d2 / (d2 + area / (2.0 * IRRADIANCE_PI)); // 1: constant with distance
            lift = min(lift, 0.5 * sqrt(d2));
        }
#if PROBES
        if (!sees(x + lift * n, x + to_light, vec2(lift > voxel ? 0.5 : 0.0, 0.5))) continue;
#endif
        height = min(height, lift);
        flux += incoming.radiance * (softened * n_l * area) * patch_.albedo.rgb;
    }
    float share = 1.0;
#if PROBES
    vec3 p = x - P.scene_from_relative.xyz;
    if (area > 0.0 && chunk.x == 0)
        share = lights_that_see(p, n, x + height * n, height > voxel ? 0.5 : 0.0, -1) > 0 ? 0.0 : 1.0;
    else if (chunk.x > 0)
        share = vpls_at(record + ivec2(3, 0)).w;
#endif
    imageStore(vpls, record, vec4(x, area));
    imageStore(vpls, record + ivec2(1, 0), vec4(n, height));
    imageStore(vpls, record + ivec2(2, 0), vec4(flux, 0.0));
    imageStore(vpls, record + ivec2(3, 0), vec4(patch_.albedo.rgb, share));
}
