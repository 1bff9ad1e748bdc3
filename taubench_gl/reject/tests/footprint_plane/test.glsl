float difference(Point now, Point history, Pixel pixel) {
    return abs(dot(history.position - now.position, now.facing)) / pixel.footprint;
}
