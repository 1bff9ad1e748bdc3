// Motion vectors as arrows from a pixel towards its previous position: one instance per grid cell, six vertices each.
// Reads    motion (previous - current, pixels, +y up)

uniform sampler2D motion;
uniform ivec2 size;
uniform ivec2 cells;
uniform int step_px;
uniform float scale; // length of an arrow per pixel of motion

void main() {
    ivec2 cell = ivec2(gl_InstanceID % cells.x, gl_InstanceID / cells.x);
    ivec2 at = min(cell * step_px + step_px / 2, size - 1);
    vec2 m = scale * texelFetch(motion, at, 0).xy;
    float far = length(m);
    vec2 along = far > 0.0 ? m / far : vec2(0.0);
    vec2 tip = vec2(at) + m, head = min(0.35 * far, 5.0) * along;
    vec2 side = 0.6 * vec2(-head.y, head.x);
    vec2 place[6] = vec2[](vec2(at), tip, tip, tip - head + side, tip, tip - head - side);
    vec2 p = far < 0.5 ? vec2(-9.0) : place[gl_VertexID]; // no arrow without motion
    gl_Position = vec4((p + 0.5) / vec2(size) * 2.0 - 1.0, 0.0, 1.0);
}
