// Outline of the selected draws, over the image: pixels that are selected and have a neighbor that is not, or reversed.
//
// Reads      ids (number of the draw + 1; 0: sky), one bit for each of its values
// Reference  references.display (outline)

layout(std430, binding = 0) readonly buffer Selected { uint selected[]; };
uniform usampler2D ids;
uniform vec4 outline_color;
out vec4 out_color;

uint is_selected(uint id) { return selected[id >> 5] >> (id & 31u) & 1u; }

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(ids, 0) - 1; // beside the image its edge is repeated
    uint here = texelFetch(ids, at, 0).r;
    uint left = texelFetch(ids, ivec2(max(at.x - 1, 0), at.y), 0).r;
    uint right = texelFetch(ids, ivec2(min(at.x + 1, last.x), at.y), 0).r;
    uint below = texelFetch(ids, ivec2(at.x, max(at.y - 1, 0)), 0).r;
    uint above = texelFetch(ids, ivec2(at.x, min(at.y + 1, last.y)), 0).r;
    uint draws = (here ^ left) | (here ^ right) | (here ^ below) | (here ^ above), other = 0u;
    // A loop, because llvmpipe computes both sides of a condition, and its reads from buffers are slow.
    for (int i = 0; i < 1 && draws != 0u; ++i) {
        uint state = is_selected(here);
        other = is_selected(left) ^ state | is_selected(right) ^ state;
        other |= is_selected(below) ^ state | is_selected(above) ^ state;
    }
    if (other == 0u) discard;
    out_color = outline_color;
}
