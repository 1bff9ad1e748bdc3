// State of the paths of a tile of pixels: layers of one RGBA32F image, one below the other.
//
// One image instead of one for each layer: drivers have as few as 8 image units.
#include "common/luminance.glsl"
#include "common/numbers.glsl"

const int ORIGIN_PDF = 0;      // xyz: origin of the next ray, relative to the camera; w: pdf of its direction, 1/sr
const int DIRECTION = 1;       // xyz: its direction, unit; w, with VOLUME: the medium that it is in
const int THROUGHPUT = 2;      // xyz: after the first bounce; w: cell of the grid of lights where the ray starts
const int FIRST_POINT = 3;     // xyz: where the paths start
const int FIRST_F0 = 4;        // with DIELECTRICS, of the visible surface, xyz: reflectance of the dielectric lobe at normal
                               // incidence; w: specular
const int FIRST_GLASS = 5;     // with TRANSMISSION, of it, x: transmission; y: relative index; z: 1 where thick; w: medium, < 0 on
                               // the viewer's side

// Four layers of each lobe.
const int LOBE_LAYERS = 4 + DIELECTRICS + TRANSMISSION;
// xyz: lobe / pdf at the first bounce; w, of this sample: of diffuse, direct luminance; of glossy, indirect luminance
#define FIRST(lobe) (LOBE_LAYERS + LOBE_##lobe)
// xyz: sum over samples; w: of diffuse, sum of squared deviations of direct luminance (Welford); of glossy, sum of the distances
// of the first bounce's hits, meters
#define DIRECT(lobe) (LOBE_LAYERS + LOBE_COUNT + LOBE_##lobe)
// xyz: sum over samples; w: of diffuse, sum of squared deviations of indirect luminance; of glossy, samples whose first bounce
// hit a surface
#define INDIRECT(lobe) (LOBE_LAYERS + 2 * LOBE_COUNT + LOBE_##lobe)
// xyz: direct light of all punctual lights
#define EXACT(lobe) (LOBE_LAYERS + 3 * LOBE_COUNT + LOBE_##lobe)

// With BIDIRECTIONAL, the end of the light subpath:
const int LIT_POINT = LOBE_LAYERS + 4 * LOBE_COUNT; // xyz: relative to the camera; w: row of the light, < 0: none
const int LIT_GEOMETRIC = LIT_POINT + 1; // xyz: unit normal of the triangle; w: metallic
const int LIT_NORMAL = LIT_POINT + 2; // xyz: shading normal; w: roughness squared
const int LIT_COLOR = LIT_POINT + 3; // xyz: base color; w: specular
const int LIT_F0 = LIT_POINT + 4; // with DIELECTRICS, xyz: as FIRST_F0

ivec2 local_pixel() { return ivec2(gl_GlobalInvocationID.xy); }

// Whose sample numbers a path has.
struct NumbersOf {
    ivec2 pixel;
    int row; // of the table: the sample
};

#if PIXEL_LIST
// The entries of a list take the place of a tile's pixels, one sample each.  x: the pixel, y: the one whose numbers it has,
// column | row << 16; z: row of the table; w: 1 where light without noise is added.
uvec4 list_entry(ivec2 local) { return pixel_list[local.y * TILE_SIZE.x + local.x]; }

ivec2 unpacked_pixel(uint word) { return ivec2(word & 0xffffu, word >> 16u); }

ivec2 pixel_of(ivec2 local) { return unpacked_pixel(list_entry(local).x); }

NumbersOf numbers_of(ivec2 local) {
    uvec4 entry = list_entry(local);
    return NumbersOf(unpacked_pixel(entry.y), int(entry.z));
}
#else
uniform ivec2 tile_origin; // pixel
uniform int sample_row;    // of the table

ivec2 pixel_of(ivec2 local) { return tile_origin + local; }

NumbersOf numbers_of(ivec2 local) { return NumbersOf(pixel_of(local), sample_row); }
#endif

bool outside_tile(ivec2 local) {
    return any(greaterThanEqual(local, TILE_SIZE)) || any(greaterThanEqual(pixel_of(local), P.size.xy));
}

vec4 load_state(ivec2 local, int layer) { return imageLoad(path_state, local + ivec2(0, layer * TILE_SIZE.y)); }

void store_state(ivec2 local, int layer, vec4 value) {
    imageStore(path_state, local + ivec2(0, layer * TILE_SIZE.y), value);
}

void add_state(ivec2 local, int layer, vec4 value) { store_state(local, layer, load_state(local, layer) + value); }

// A contribution that is not finite is counted and left out of the sum.
vec3 finite_or_counted(vec3 c) {
    if (!non_finite(c)) return c;
    atomicAdd(path_counts[COUNT_NON_FINITE], 1u);
    return vec3(0.0);
}
