// Depth alone, before the geometry pass: no outputs.

void main() {}
