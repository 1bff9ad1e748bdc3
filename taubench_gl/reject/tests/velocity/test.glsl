float difference(Point now, Point history, Pixel pixel) { return distance(now.motion, history.motion); }
