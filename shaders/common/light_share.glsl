// Which of the lights with reflective shadow maps see a patch.  Needs FACE records as ``faces``, the record P, voxels.glsl.
#include "common/rsm_face.glsl"

// Number of lights with maps that see the patch at p (relative to the camera), without light ``row``.  aim: a point just
// above it, scene space; slack: as in the probes' rays.
int lights_that_see(vec3 p, vec3 n, vec3 aim, float slack, int row) {
    int count = 0;
    for (int k = 0; k < P.counts.z; ++k) {
        ShadowFace face = faces[k];
        if (face.extent.z == 0.0 || int(face.extent.w) == row) continue; // off, or left out
        vec3 q = p - face.origin.xyz;
        vec2 at;
        if (!face_covers(face, q, at)) continue;
        vec3 to_light = face.origin.w > 0.5 ? -face.forward.xyz * face.forward.w : -q;
        if (dot(n, to_light) <= 0.0) continue;
        if (sees(aim, p + P.scene_from_relative.xyz + to_light, vec2(slack, 0.5))) ++count;
    }
    return count;
}
