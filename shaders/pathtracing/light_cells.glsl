// Punctual lights and emissive triangles by what they bring to the cell of a grid that a point lies in.
// Reads      light_cells: first entry of each cell, and the end, of lights and then of emissive triangles;
//            light_entries: cumulative probability; row of the light, or group of EMITTER_GROUP triangles.
// Reference  metrics.stochastic.LightCells, cell_choice

// Cell 0 is outside of the grid, and has every light that is on.
int cell_of(vec3 p) {
    vec3 at = floor((p - P.cells.xyz) * P.cells.w);
    if (!all(greaterThanEqual(at, vec3(0.0))) || !all(lessThan(at, vec3(P.cell_counts.xyz)))) return 0;
    return 1 + (int(at.x) * P.cell_counts.y + int(at.y)) * P.cell_counts.z + int(at.z);
}

// Entries of ``cell``, (first, number).  ``table``: 0 of lights, P.cell_counts.w of emissive triangles.
ivec2 entries_of(int table, int cell) {
    int first = light_cells[table + cell];
    return ivec2(first, light_cells[table + cell + 1] - first);
}

int entry_row(int entry) { return int(light_entries[entry].y); }

// The first of the entries ``around`` whose cumulative probability is above u.
int choose_entry(float u, ivec2 around) {
    int low = around.x, high = around.x + around.y - 1;
    while (low < high) {
        int middle = (low + high) >> 1;
        if (u < light_entries[middle].x) high = middle;
        else low = middle + 1;
    }
    return low;
}

float cumulative_before(int entry, ivec2 around) { return entry > around.x ? light_entries[entry - 1].x : 0.0; }

float entry_probability(int entry, ivec2 around) { return light_entries[entry].x - cumulative_before(entry, around); }

#if EMITTERS
// Cumulative probability by power before and at the end of a group of emissive triangles.
vec2 group_span(int group) {
    int first = group * EMITTER_GROUP;
    return vec2(emitter_cumulative(first - 1), emitter_cumulative(min(first + EMITTER_GROUP, EMITTER_COUNT) - 1));
}

// Probability with which row ``emitter`` is sampled from points in ``cell``.
float emitter_probability(int emitter, int cell) {
    if (emitter < 0) return 0.0;
    ivec2 around = entries_of(P.cell_counts.w, cell);
    int group = emitter / EMITTER_GROUP, low = around.x, high = around.x + around.y;
    while (low < high) {
        int middle = (low + high) >> 1;
        if (entry_row(middle) < group) low = middle + 1;
        else high = middle;
    }
    if (low == around.x + around.y || entry_row(low) != group) return 0.0;
    float probability = entry_probability(low, around);
    if (EMITTER_GROUP > 1) {
        vec2 span = group_span(group);
        probability *= emitter_probability(emitter) / (span.y - span.x);
    }
    return probability;
}

// The row that ``pick`` in [0, 1) chooses for points in ``cell``; -1: none shines.
int emitter_around(float pick, int cell) {
    ivec2 around = entries_of(P.cell_counts.w, cell);
    if (around.y == 0) return -1;
    int entry = choose_entry(pick, around), group = entry_row(entry);
    if (EMITTER_GROUP == 1) return group;
    vec2 span = group_span(group);
    float rest = (pick - cumulative_before(entry, around)) / entry_probability(entry, around);
    int first = group * EMITTER_GROUP;
    return emitter_between(first, min(first + EMITTER_GROUP, EMITTER_COUNT) - 1, mix(span.x, span.y, rest));
}
#endif
