float difference(Point now, Point history, Pixel pixel) {
    return distance(now.position, history.position) * max(pixel.cosine, least_cosine) / pixel.footprint;
}
