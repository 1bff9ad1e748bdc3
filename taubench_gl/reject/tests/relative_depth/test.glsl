float difference(Point now, Point history, Pixel pixel) { return abs(history.depth - now.depth) / now.depth; }
