// Changes to the next pixels, of both sides the smaller one.
// Needs      inside(ivec2), is_surface(ivec2), then_depth(ivec2), normal_of(ivec2)

// The side, -1 or 1, on which the depth changes less along one axis; 0 where neither neighbor is a surface.
int smoother_side(ivec2 at, ivec2 step, float here) {
    float best = 1e30;
    int found = 0;
    for (int side = -1; side <= 1; side += 2) {
        ivec2 other = at + side * step;
        if (other != inside(other) || !is_surface(other)) continue;
        float change = abs(then_depth(other) - here);
        if (change < best) {
            best = change;
            found = side;
        }
    }
    return found;
}

float slope(ivec2 at, ivec2 step, float here) {
    int side = smoother_side(at, step, here);
    return side == 0 ? 0.0 : float(side) * (then_depth(at + side * step) - here);
}

float turn(ivec2 at, ivec2 step, vec3 here) {
    float best = 1e30;
    for (int side = -1; side <= 1; side += 2) {
        ivec2 other = at + side * step;
        if (other != inside(other) || !is_surface(other)) continue;
        best = min(best, distance(normal_of(other), here));
    }
    return best == 1e30 ? 0.0 : best;
}
