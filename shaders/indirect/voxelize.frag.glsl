// Occupancy of a coarse grid, one bit a voxel, which blocks the probes' rays.
//
// Writes     (sets bits of) voxels.
in vec3 pos_rel;

void main() {
    vec3 place = pos_rel;
#if POSED
    place += P.scene_from_relative.xyz; // fixed draws are relative to the origin of scene space
#endif
    vec3 cell = (place - P.grid_origin.xyz) / P.grid_origin.w;
    ivec3 c = ivec3(floor(cell));
    if (any(lessThan(c, ivec3(0))) || any(greaterThanEqual(c, ivec3(GRID)))) return;
    uint index = uint((c.z * GRID + c.y) * GRID + c.x);
    atomicOr(voxels[index >> 5], 1u << (index & 31u));
}
