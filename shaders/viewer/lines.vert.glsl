// Lines in world space, relative to the viewing camera.

in vec3 in_position;
in vec3 in_color;
uniform mat4 clip_from_relative;
uniform vec3 forward;
out vec3 color;
out float depth; // planar, scene units

void main() {
    color = in_color;
    depth = dot(forward, in_position);
    gl_Position = clip_from_relative * vec4(in_position, 1.0);
}
