float difference(Point now, Point history, Pixel pixel) {
    float change = abs(pixel.depth_gradient.x) + abs(pixel.depth_gradient.y); // fwidth
    float depth = abs(history.depth - now.depth) / (change + bias);
    float normal = distance(now.normal, history.normal) / (pixel.normal_change + bias);
    return max(depth / depth_changes, normal / normal_changes);
}
