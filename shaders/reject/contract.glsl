// What a rejection test gets.  Space: relative to the previous camera, world axes, meters of the scene.
struct Point {
    vec3 position; // now: where the surface point was; history: the point that the history pixel shows
    float depth;   // planar, of that position
    vec3 normal;   // unit, shading
    vec3 facing;   // unit, of the triangle
    uint object;   // number of the draw
    vec2 motion;   // previous - current, pixels, +x right, +y up; history: of the pair before
    vec3 radiance; // direct + indirect, times exposure; of color tests
};

struct Pixel {
    ivec2 at;            // this pixel
    vec2 history_at;     // where its history is; the test gets the nearest pixel
    vec2 depth_gradient; // of now.depth, per pixel to the right and up: of both sides the smaller change
    float normal_change; // of now.normal, likewise: sum of both axes
    float footprint;     // width of a pixel at now.depth, meters
    float image_height;  // of the whole image there, meters
    float cosine;        // of the angle between view ray and the triangle's normal, 0 (grazing) to 1
};

// Radiance of a pixel of this frame, times exposure; clamped to the image.  In color tests.
vec3 radiance_at_pixel(ivec2 at);
