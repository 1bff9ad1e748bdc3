// Morphing and skinning of every posed vertex, in this frame and the frame before, into camera-relative positions.
//
// Reads      source attributes, joints, weights, morph displacements, palettes (relative_from_bind, 3 rows each; one
//            matrix per joint, or the node's where there is no skin).
// Writes     posed position, previous position (with HAS_PREVIOUS), normal, tangent of the posed vertex pool.
// Reference  animation.pose.pose_vertices
#include "common/affine.glsl"

vec3 load3(uint base, uint index) {
    uint at = base + 3u * index;
    return vec3(source[at], source[at + 1u], source[at + 2u]);
}

Affine palette(uint index) { return Affine(palettes[3u * index], palettes[3u * index + 1u], palettes[3u * index + 2u]); }

Affine blend(DeformJob job, uint vertex, uint base) {
    if (job.influences == 0u) return palette(base);
    Affine sum = Affine(vec4(0.0), vec4(0.0), vec4(0.0));
    for (uint i = 0u; i < job.influences; ++i) {
        uint at = vertex * job.influences + i;
        float weight = source[job.weights + at];
        if (weight == 0.0) continue;
        Affine m = palette(base + joints[job.joints + at]);
        sum.x += weight * m.x;
        sum.y += weight * m.y;
        sum.z += weight * m.z;
    }
    return sum;
}

void main() {
    uvec2 group = groups[gl_WorkGroupID.x];
    DeformJob job = jobs[group.x];
    uint vertex = group.y + gl_LocalInvocationID.x;
    if (vertex >= job.vertex_count) return;

    vec3 position = load3(job.positions, vertex), previous = position;
    vec3 normal = load3(job.normals, vertex);
    uint tangent_at = job.tangents + 4u * vertex;
    vec4 tangent = vec4(source[tangent_at], source[tangent_at + 1u], source[tangent_at + 2u], source[tangent_at + 3u]);
    for (uint i = job.first_morph; i < job.first_morph + job.morph_count; ++i) {
        MorphUse morph = morphs[i];
        vec3 delta = load3(morph.positions, vertex);
        position += morph.weight * delta;
        previous += morph.prev_weight * delta;
        if (morph.normals != NOTHING) normal += morph.weight * load3(morph.normals, vertex);
        if (morph.tangents != NOTHING) tangent.xyz += morph.weight * load3(morph.tangents, vertex);
    }

    Affine relative_from_bind = blend(job, vertex, job.palette);
    uint at = job.posed_vertex + vertex;
    vec3 p = transform_point(relative_from_bind, position);
    vec3 n = safe_normalize(transform_normal(relative_from_bind, normal));
    vec3 t = safe_normalize(transform_vector(relative_from_bind, tangent.xyz));
    for (uint c = 0u; c < 3u; ++c) {
        out_position[3u * at + c] = p[c];
        out_normal[3u * at + c] = n[c];
        out_tangent[4u * at + c] = t[c];
    }
    out_tangent[4u * at + 3u] = tangent.w * job.mirror;
#if HAS_PREVIOUS
    Affine before = blend(job, vertex, job.prev_palette);
    vec3 q = transform_point(before, previous);
    bool point = before.x.xyz == vec3(0.0) && before.y.xyz == vec3(0.0) && before.z.xyz == vec3(0.0);
    if (point && job.collapsed != 0u) q = vec3(uintBitsToFloat(0x7f800000u)); // infinite: INVALID in the mask
    for (uint c = 0u; c < 3u; ++c) out_previous[3u * at + c] = q[c];
#endif
}
