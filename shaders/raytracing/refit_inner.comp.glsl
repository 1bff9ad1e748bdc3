// Inner nodes of one height of the trees of posed draws: the union of the bounds of both children.
//
// Reads      refit_inner (node, first child, second child, last word), nodes one height below.
// Writes     nodes of posed draws.
// Reference  tests/raytracing/test_refit.py

uniform int first, count;

ivec2 texel(uint i) { return ivec2(i & ((1u << TRACE_ROW_BITS) - 1u), i >> TRACE_ROW_BITS); }

void main() {
    if (gl_GlobalInvocationID.x >= uint(count)) return;
    uvec4 node = refit_inner_at(texel(uint(first) + gl_GlobalInvocationID.x));
    ivec3 a = ivec3(trace_nodes_at(texel(node.y)).xyz), b = ivec3(trace_nodes_at(texel(node.z)).xyz);
    ivec3 low = min((a << 16) >> 16, (b << 16) >> 16), high = max(a >> 16, b >> 16);
    imageStore(trace_nodes, texel(node.x), uvec4((uvec3(low) & 0xFFFFu) | uvec3(high) << 16, node.w));
}
