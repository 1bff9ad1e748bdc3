float difference(Point now, Point history, Pixel pixel) {
    float change = abs(pixel.depth_gradient.x) + abs(pixel.depth_gradient.y);
    return abs(history.depth - now.depth) / (change + least * now.depth);
}
