// Blockwise regression: in each block of pixels the illumination is fitted by a linear combination of features.
//
// Paper    Koskela et al. 2019, feature fitting: features 1, normal, world position, and squares of the position; positions
//          scaled to [0, 1] in the block; QR factorization of features and color; zero-mean noise on the features
//          against rank deficiency, without noise in the reconstruction; blocks at a pseudo-random offset per frame;
//          pixels outside the image are mirrored into it.
// Reference references.reuse_methods.block_regression, block_features, feature_noise, block_offset
// Departs  Modified Gram-Schmidt on the features with the color appended, instead of Householder reflections: it is
//          as stable for least squares (Bjorck 1967) and needs one reduction per column.  Squares are of the scaled position,
//          relative to the camera: the same space of functions, better conditioned.  Their published code squares world
//          coordinates and scales what spans more than 1 m: far from the origin its squares are nearly linear and drown in the
//          noise.  Sky pixels take no part and keep their color; a block with fewer than 20 surface pixels uses the
//          constant feature alone.  The result is at least 0.
#include "noise.glsl"

const int FEATURES = 10, COLUMNS = FEATURES + 3, ROWS = block_size.x * block_size.y / block_threads, PARTS = 16;
const int FEWEST = 2 * FEATURES;      // surface pixels for a fit of all features
const float LEAST_RANGE = 1.0e-3;     // meters: a position that varies less is scaled as if it varied by this much

shared float partial[COLUMNS][block_threads];
shared float subtotal[COLUMNS][PARTS];
shared float total[COLUMNS];
shared float upper[FEATURES][COLUMNS]; // unit upper triangle, then the projections of the color
shared float weight[FEATURES][3];

// total[c] = sum or minimum over the block of partial[c], for c < count.
void reduce(int count, int thread, bool smallest) {
    barrier();
    int column = thread / PARTS, part = thread % PARTS;
    if (column < count) {
        float value = partial[column][part];
        for (int i = part + PARTS; i < block_threads; i += PARTS) {
            float other = partial[column][i];
            value = smallest ? min(value, other) : value + other;
        }
        subtotal[column][part] = value;
    }
    barrier();
    if (thread < count) {
        float value = subtotal[thread][0];
        for (int i = 1; i < PARTS; ++i) {
            float other = subtotal[thread][i];
            value = smallest ? min(value, other) : value + other;
        }
        total[thread] = value;
    }
    barrier();
}

int mirrored(int i, int size) {
    i = i < 0 ? -i - 1 : i;
    i = i >= size ? 2 * size - i - 1 : i;
    return clamp(i, 0, size - 1); // images smaller than a block
}

void block_features(vec3 scaled, vec3 normal, out float f[FEATURES]) {
    f[0] = 1.0;
    for (int i = 0; i < 3; ++i) {
        f[1 + i] = normal[i];
        f[4 + i] = scaled[i];
        f[7 + i] = scaled[i] * scaled[i];
    }
}

void reuse_block(ivec2 block, int thread) {
    ivec2 origin = block * block_size - block_offset();
    if (any(greaterThanEqual(origin, frame.size.xy))) return; // the whole block
    vec3 low = vec3(1.0e30), high = vec3(-1.0e30);
    for (int r = 0; r < ROWS; ++r) {
        int k = r * block_threads + thread;
        ivec2 at = origin + ivec2(k % block_size.x, k / block_size.x);
        vec4 position = fetch_position(ivec2(mirrored(at.x, frame.size.x), mirrored(at.y, frame.size.y)));
        if (position.w > 0.0) {
            low = min(low, position.xyz);
            high = max(high, position.xyz);
        }
    }
    for (int i = 0; i < 3; ++i) {
        partial[i][thread] = low[i];
        partial[3 + i][thread] = -high[i];
    }
    reduce(6, thread, true);
    low = vec3(total[0], total[1], total[2]);
    vec3 range = max(-vec3(total[3], total[4], total[5]) - low, vec3(LEAST_RANGE));

    float rows[ROWS][COLUMNS];
    for (int r = 0; r < ROWS; ++r) {
        int k = r * block_threads + thread;
        ivec2 at = origin + ivec2(k % block_size.x, k / block_size.x);
        ivec2 p = ivec2(mirrored(at.x, frame.size.x), mirrored(at.y, frame.size.y));
        vec4 position = fetch_position(p);
        float f[FEATURES];
        block_features((position.xyz - low) / range, fetch_normal(p).xyz, f);
        bool surface = position.w > 0.0;
        for (int i = 0; i < FEATURES - 1; i += 4) {
            vec4 more = noise * (2.0 * random_numbers(at, i / 4) - 1.0);
            for (int j = 0; j < 4; ++j)
                if (i + j < FEATURES - 1) f[1 + i + j] += more[j]; // the constant has no noise
        }
        vec3 color = fetch_accumulated(p).rgb;
        for (int i = 0; i < FEATURES; ++i) rows[r][i] = surface ? f[i] : 0.0;
        for (int i = 0; i < 3; ++i) rows[r][FEATURES + i] = surface ? color[i] : 0.0;
    }

    int used = FEATURES;
    for (int c = 0; c < FEATURES; ++c) {
        for (int j = 0; j < COLUMNS; ++j) {
            float sum = 0.0;
            for (int r = 0; r < ROWS; ++r) sum += rows[r][c] * rows[r][j];
            partial[j][thread] = sum;
        }
        reduce(COLUMNS, thread, false);
        if (c == 0 && total[0] < float(FEWEST)) used = 1;
        float inverse = c < used && total[c] > 0.0 ? 1.0 / total[c] : 0.0;
        for (int j = 0; j < COLUMNS; ++j) {
            if (j <= c) continue;
            float along = total[j] * inverse;
            for (int r = 0; r < ROWS; ++r) rows[r][j] -= along * rows[r][c];
            if (thread == 0) upper[c][j] = along;
        }
    }
    barrier();
    if (thread < 3) {
        for (int c = FEATURES - 1; c >= 0; --c) {
            float w = upper[c][FEATURES + thread];
            for (int j = c + 1; j < FEATURES; ++j) w -= upper[c][j] * weight[j][thread];
            weight[c][thread] = w;
        }
    }
    barrier();

    for (int r = 0; r < ROWS; ++r) {
        int k = r * block_threads + thread;
        ivec2 p = origin + ivec2(k % block_size.x, k / block_size.x);
        if (!in_image(p)) continue;
        vec4 position = fetch_position(p);
        vec3 color = fetch_accumulated(p).rgb;
        if (position.w > 0.0) {
            float f[FEATURES];
            block_features((position.xyz - low) / range, fetch_normal(p).xyz, f);
            color = vec3(0.0);
            for (int i = 0; i < FEATURES; ++i) color += f[i] * vec3(weight[i][0], weight[i][1], weight[i][2]);
            color = max(color, 0.0);
        }
        write_fitted(p, vec4(color, 1.0));
    }
}
