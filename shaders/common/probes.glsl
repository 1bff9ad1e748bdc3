// Where the probes are: a grid in scene space, x fastest.
int probe_count() { return P.probe_counts.x * P.probe_counts.y * P.probe_counts.z; }

ivec3 probe_cell(int i) {
    ivec3 n = P.probe_counts.xyz;
    return ivec3(i % n.x, (i / n.x) % n.y, i / (n.x * n.y));
}

vec3 probe_place(int i) { return P.probe_origin.xyz + vec3(probe_cell(i)) * P.probe_step.xyz; }

// Texel of the first of a probe's six sides, which lie beside each other.
ivec2 probe_texel(ivec3 cell) { return ivec2(6 * cell.x, cell.z * P.probe_counts.y + cell.y); }
