// Weight of the new frame.  Paper: Schied et al. 2017, section 4.1.   Reference  references.reuse_methods.new_weight
// Departs  max(1 / n, alpha), as in the authors' later code, so that the first frames have equal weights; the paper's
//          alpha is constant.

// Frames that count as history of pixel p, of those found there.
float frames_left(ivec2 p, float frames) { return frames; }

// The color that history is blended with is the input.
void report_input(ivec2 p) {}

float new_weight(ivec2 p, float frames, float least) { return max(1.0 / (frames + 1.0), least); }
