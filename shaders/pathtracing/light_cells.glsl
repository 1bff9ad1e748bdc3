// Lights by what they bring to the cell of a grid that a point lies in.
// Reads      light_cells: first entry of each cell, and the end; light_entries: cumulative probability, row of the light.
// Reference  metrics.stochastic.LightCells, cell_choice

// Entries of the cell of p, (first, number); cell 0 is outside of the grid, and has every light that is on.
ivec2 lights_around(vec3 p) {
    vec3 at = floor((p - P.cells.xyz) * P.cells.w);
    int cell = 0;
    if (all(greaterThanEqual(at, vec3(0.0))) && all(lessThan(at, vec3(P.cell_counts.xyz)))) {
        cell = 1 + (int(at.x) * P.cell_counts.y + int(at.y)) * P.cell_counts.z + int(at.z);
    }
    int first = light_cells[cell];
    return ivec2(first, light_cells[cell + 1] - first);
}

int entry_light(int entry) { return int(light_entries[entry].y); }

// The first entry of the cell ``around`` whose cumulative probability is above u.
int choose_entry(float u, ivec2 around) {
    int low = around.x, high = around.x + around.y - 1;
    while (low < high) {
        int middle = (low + high) >> 1;
        if (u < light_entries[middle].x) high = middle;
        else low = middle + 1;
    }
    return low;
}

float entry_probability(int entry, ivec2 around) {
    return light_entries[entry].x - (entry > around.x ? light_entries[entry - 1].x : 0.0);
}
