// Lines: transparent behind surfaces.

uniform sampler2D position;
in vec3 color;
in float depth;
out vec4 out_color;

void main() {
    float surface = texelFetch(position, ivec2(gl_FragCoord.xy), 0).w;
    out_color = vec4(color, surface > 0.0 && depth > surface ? 0.25 : 1.0);
}
