// Divergence of the motion, 0 .. 1: in the image and in time.  It counts as composition, which ends locks, widens the kernel and
// lowers the trust in history.
//
// Paper    AMD's published shader of the depth clip.  In the image: 1 - the least cosine, times relative length, between the motion of
//          the pixel and that of 3x3 pixels, fully from motion of 1 % of the image on.  In time: 1 - the length of the dilated
//          motion of the previous frame, where the pixel was, over that of this frame, from 1 pixel of the result on and fully from 20;
//          less the divergence of the depth, 1 - least / largest dilated depth of 3x3 pixels, 0 beside the sky.
// Reference references.reuse_methods.fsr2_motion_divergence
// Departs  Samples outside the image repeat those at the border, where FSR2 counts their depth as 0.
const float STILL_PX = 0.01;   // motion of a pixel that does not move, input pixels
const float FULL_SHARE = 0.01; // of the image

float divergence_in_the_image(ivec2 p) {
    vec2 own = fetch_motion(p), size = vec2(input_size());
    float most = length(own / size), least = 1.0;
    if (length(own) <= STILL_PX) return 0.0;
    for (int i = 0; i < 9; ++i) {
        vec2 other = fetch_motion(p + ivec2(i % 3 - 1, i / 3 - 1));
        most = max(most, length(other / size));
        least = min(least, dot(other / size, own / size) / (most * most));
    }
    return clamp(1.0 - least, 0.0, 1.0) * clamp(most / FULL_SHARE, 0.0, 1.0);
}

float divergence_in_time(ivec2 p, vec2 motion) {
    float distance_px = length(motion * output_scale());
    vec2 at = clamp(vec2(p) + motion, vec2(0.0), vec2(input_size() - 1));
    if (frame.has_history == 0u || distance_px <= 1.0) return 0.0;
    vec2 size = vec2(input_size()), before = sample_prev_dilated(at).xy;
    float slower = clamp(length(before / size) / length(motion / size), 0.0, 1.0);
    return (1.0 - slower) * clamp(pow(distance_px / 20.0, 3.0), 0.0, 1.0);
}

float divergence_of_depth(ivec2 p) {
    float low = 1.0e30, high = 0.0;
    for (int i = 0; i < 9; ++i) {
        float depth = fetch_position(nearest_surface(p + ivec2(i % 3 - 1, i / 3 - 1))).w;
        if (!(depth > 0.0)) return 0.0;
        low = min(low, depth);
        high = max(high, depth);
    }
    return 1.0 - low / high;
}

float motion_divergence(ivec2 p, vec2 motion) {
    return max(divergence_in_the_image(p), clamp(divergence_in_time(p, motion) - divergence_of_depth(p), 0.0, 1.0));
}
