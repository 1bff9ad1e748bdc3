// Positions in the reflective shadow maps of what stands still, relative to the current camera.
//
// Reads      positions in scene space.
// Writes     rsm_position.
void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, imageSize(position_out)))) return;
    vec4 place = fixed_position_at(at);
    imageStore(position_out, at, vec4(place.xyz - P.scene_from_relative.xyz, place.w));
}
