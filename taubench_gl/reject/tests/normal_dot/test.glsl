float difference(Point now, Point history, Pixel pixel) { return max(1.0 - dot(now.normal, history.normal), 0.0); }
