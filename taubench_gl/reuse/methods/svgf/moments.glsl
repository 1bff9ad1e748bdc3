// Variance from first and second moments.   Reference  references.reuse_methods.moments_variance
// Departs  Less a millionth of the second moment: what rounding to float32 leaves of the difference of equal values would
//          blend pixels of equal luminance and other colors for ever.
vec2 variance_of(vec2 first, vec2 second) { return max(second - first * first - 1.0e-6 * second, 0.0); }
