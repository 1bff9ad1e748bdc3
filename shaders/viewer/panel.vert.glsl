// Panels: triangles in window points, origin at the top left.

in vec2 in_position;
in vec2 in_uv;
in vec4 in_color;
uniform vec2 points; // window size
out vec2 uv;
out vec4 color;

void main() {
    uv = in_uv;
    color = in_color;
    gl_Position = vec4(2.0 * in_position.x / points.x - 1.0, 1.0 - 2.0 * in_position.y / points.y, 0.0, 1.0);
}
