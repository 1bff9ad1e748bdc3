// Speed on Mesa's llvmpipe, which renders on the CPU.  Nothing here changes a result; the Python side is
// taubench_gl/frame/tuning.py.
//
// LLVMPIPE  1 on software rendering.

#if LLVMPIPE
#define RETURN_IF(condition) // both sides of a branch run anyway
#else
#define RETURN_IF(condition) if (condition) return
#endif

// Parameters of a pass that counts in a loop over pixels, as P; call load_parameters() first.  llvmpipe loads a uniform at
// every use, with a test of its bounds and a broadcast, and cannot move that out of the loop, because the atomics might
// write the block: half of the mask pass was spent there.  A computed value stays in a register, so each field is xor-ed
// with a zero that the compiler cannot see.
#ifdef PARAMETERS
#ifdef KEPT_FIELDS
float keep(float v) { return uintBitsToFloat(floatBitsToUint(v) ^ uint(parameters.size.z)); }
vec4 keep(vec4 v) { return uintBitsToFloat(floatBitsToUint(v) ^ uint(parameters.size.z)); }
mat4 keep(mat4 m) { return mat4(keep(m[0]), keep(m[1]), keep(m[2]), keep(m[3])); }

PARAMETERS P;

#define KEEP_FIELD(field) P.field = keep(parameters.field);
void load_parameters() {
    P = parameters;
    KEPT_FIELDS(KEEP_FIELD)
}
#else
#define P parameters
#define load_parameters()
#endif
#endif
