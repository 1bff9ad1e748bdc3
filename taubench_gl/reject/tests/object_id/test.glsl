float difference(Point now, Point history, Pixel pixel) { return now.object == history.object ? 0.0 : 1.0; }
