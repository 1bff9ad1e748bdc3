// Tests on the bits of a float: no compiler's fast-math can remove them.
bool non_finite(float x) { return (floatBitsToUint(x) & 0x7f800000u) == 0x7f800000u; }
bool non_finite(vec2 v) { return non_finite(v.x) || non_finite(v.y); }
bool non_finite(vec3 v) { return non_finite(v.xy) || non_finite(v.z); }
bool non_finite(vec4 v) { return non_finite(v.xyz) || non_finite(v.w); }
