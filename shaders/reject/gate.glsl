// Whether a rejection test keeps the history reservoir of a pixel: gate.glsl of restir-di.
//
// Needs      before it reject/contract.glsl and float difference(Point now, Point history, Pixel pixel)

vec3 radiance_at_pixel(ivec2 at) { return vec3(0.0); } // reservoirs have no shaded image: no test of color is a gate
vec3 history_radiance(ivec2 at) { return vec3(0.0); }
#include "reject/history.glsl"

bool reusable_history(ivec2 p, ivec2 q) { return inside(previous_px(p)) && !history_rejected(p, previous_px(p)); }
void before_gate(ivec2 p) { write_moved(p, fetch_motion(p)); }
