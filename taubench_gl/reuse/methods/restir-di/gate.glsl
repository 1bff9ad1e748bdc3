// Whether pixel p keeps the history reservoir of pixel q of the previous frame.  Methods with base restir-di have another one.
bool reusable_history(ivec2 p, ivec2 q) { return reusable(p); }
