// Directions to an environment image by its luminance.
// Reads      environment_choice   Needs: common/brdf_sampling.glsl, ENVIRONMENT_CELLS
#if ENVIRONMENT_IMAGE
// Cells of equal width in longitude and of equal angle in latitude; a cell's probability is uniform in solid angle.
// Column ``width`` of ``environment_choice`` holds the cumulative probability of the rows.
int search_row(float u, int height, int width) {
    int low = 0, high = height - 1;
    while (low < high) {
        int middle = (low + high) >> 1;
        if (u < environment_choice_at(ivec2(width, middle)).x) high = middle;
        else low = middle + 1;
    }
    return low;
}

int search_column(float u, int row, int width) {
    int low = 0, high = width - 1;
    while (low < high) {
        int middle = (low + high) >> 1;
        if (u < environment_choice_at(ivec2(middle, row)).x) high = middle;
        else low = middle + 1;
    }
    return low;
}

float within(float u, float from, float to) { return clamp((u - from) / max(to - from, 1.0e-20), 0.0, 0.9999999); }

BrdfSample sample_environment(vec2 u) {
    int height = ENVIRONMENT_CELLS, width = 2 * ENVIRONMENT_CELLS;
    int row = search_row(u.x, height, width);
    float row_low = row > 0 ? environment_choice_at(ivec2(width, row - 1)).x : 0.0;
    float down = within(u.x, row_low, environment_choice_at(ivec2(width, row)).x);
    int column = search_column(u.y, row, width);
    float column_low = column > 0 ? environment_choice_at(ivec2(column - 1, row)).x : 0.0;
    float right = within(u.y, column_low, environment_choice_at(ivec2(column, row)).x);
    float top = cos(PI * float(row) / float(height)), bottom = cos(PI * float(row + 1) / float(height));
    float y = mix(top, bottom, down), sine = sqrt(max(1.0 - y * y, 0.0));
    float phi = ((float(column) + right) / float(width) - 0.5) * 2.0 * PI;
    return BrdfSample(vec3(sine * cos(phi), y, sine * sin(phi)), environment_choice_at(ivec2(column, row)).y);
}
#endif
