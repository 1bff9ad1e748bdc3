// Depth pre-pass: no outputs.

void main() {}
