float difference(Point now, Point history, Pixel pixel) {
    vec3 low = now.radiance, high = now.radiance;
    for (int i = 0; i < 9; ++i) {
        vec3 other = radiance_at_pixel(pixel.at + ivec2(i % 3 - 1, i / 3 - 1));
        low = min(low, other);
        high = max(high, other);
    }
    return distance(history.radiance, clamp(history.radiance, low, high));
}
