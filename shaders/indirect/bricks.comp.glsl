// Bricks of 4 x 4 x 4 voxels, a texel each, for visibility rays: the bits of their voxels, and the distance to the nearest
// brick that is not empty.  One invocation for each row of bricks along x.
//
// Reads      occupancy bits (voxelize.frag.glsl) of what no animation moves and of the rest; with DISTANCES the bricks.
// Writes     bricks, xy: bits, x fastest, then y, then z; z: Chebyshev distance in bricks, at most FAR, 0 = not empty.
//            rows: a bit for each brick of a row that is not empty.
const int BRICKS = GRID / 4, FAR = 4;

void main() {
    int row = int(gl_GlobalInvocationID.x);
    if (row >= BRICKS * BRICKS) return;
    int y = row % BRICKS, z = row / BRICKS;
#if DISTANCES
    uint near[FAR]; // bricks with something within 0, 1 .. bricks
    for (int r = 0; r < FAR; ++r) {
        uint any_of = 0u;
        for (int k = -r; k <= r; ++k)
            for (int j = -r; j <= r; ++j) {
                ivec2 at = ivec2(y + j, z + k);
                if (all(lessThan(uvec2(at), uvec2(BRICKS)))) any_of |= rows_at(at).r; // negative ones are huge
            }
        near[r] = any_of;
        for (int i = 1; i <= r; ++i) near[r] |= any_of << i | any_of >> i;
    }
    for (int x = 0; x < BRICKS; ++x) {
        uvec4 brick = bricks_at(ivec2(x, row));
        brick.z = 0u;
        for (int r = 0; r < FAR; ++r) brick.z += ~near[r] >> uint(x) & 1u;
        imageStore(bricks, ivec2(x, row), brick);
    }
#else
    uint filled = 0u;
    for (int word = 0; word < GRID / 32; ++word) {
        uint bits[16];
        for (int i = 0; i < 16; ++i) {
            int at = ((4 * z + i / 4) * GRID + 4 * y + i % 4) * (GRID / 32) + word;
            bits[i] = still[at] | moving[at];
        }
        for (int x = 0; x < 8; ++x) {
            uvec2 brick = uvec2(0u);
            for (int i = 0; i < 16; ++i) brick[i / 8] |= (bits[i] >> uint(4 * x) & 15u) << uint(4 * (i % 8));
            imageStore(bricks, ivec2(8 * word + x, row), uvec4(brick, 0u, 0u));
            if ((brick.x | brick.y) != 0u) filled |= 1u << uint(8 * word + x);
        }
    }
    imageStore(rows, ivec2(y, z), uvec4(filled));
#endif
}
