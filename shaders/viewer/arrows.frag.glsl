// One color for all arrows.

uniform vec4 arrow_color;
out vec4 out_color;

void main() { out_color = arrow_color; }
