// The paths of a tile that go on to a vertex, without gaps: no lane and no work group has paths that have ended.
//
// Reads and writes  going_on: places of paths, one list for even and one for odd vertices;
//                   going_on_counts: of each vertex, for even and for odd samples: work groups (x, 1, 1), paths.

uniform int odd_sample; // 0 or 1

const uint PATHS = uint(TILE_SIZE.x * TILE_SIZE.y);

uint list_of(int vertex) { return uint(vertex & 1) * PATHS; }
int counts_of(int odd, int vertex) { return 4 * (odd * PATH_LISTS + vertex); }

// Of the path that this invocation extends at ``vertex``; false: there is none.
bool path_at(int vertex, out ivec2 local) {
    uint at = gl_GlobalInvocationID.x;
    if (at >= going_on_counts[counts_of(odd_sample, vertex) + 3]) return false;
    uint path = going_on[list_of(vertex) + at];
    local = ivec2(path % uint(TILE_SIZE.x), path / uint(TILE_SIZE.x));
    return true;
}

void go_on(ivec2 local, int vertex) {
    int counts = counts_of(odd_sample, vertex);
    uint at = atomicAdd(going_on_counts[counts + 3], 1u);
    if (at % uint(PATH_GROUP) == 0u) atomicAdd(going_on_counts[counts], 1u);
    going_on[list_of(vertex) + at] = uint(local.y * TILE_SIZE.x + local.x);
}

// No path goes on of a sample that is ``odd``.
void empty_lists(int odd) {
    for (int vertex = 0; vertex < PATH_LISTS; ++vertex) {
        going_on_counts[counts_of(odd, vertex)] = 0u;
        going_on_counts[counts_of(odd, vertex) + 3] = 0u;
    }
}
