float difference(Point now, Point history, Pixel pixel) { return distance(now.normal, history.normal); }
