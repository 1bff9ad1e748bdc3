// Whether pixel p keeps the history reservoir of pixel q of the previous frame.  ``reject method --history reservoirs`` writes others.
bool reusable_history(ivec2 p, ivec2 q) { return reusable(p); }
void before_gate(ivec2 p) {}
