float difference(Point now, Point history, Pixel pixel) {
    float off_plane = abs(dot(history.position - now.position, now.facing));
    return off_plane * max(pixel.cosine, 0.05) / pixel.image_height;
}
