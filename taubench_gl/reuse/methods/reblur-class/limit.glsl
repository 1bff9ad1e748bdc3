// Limits on the luminance of both lobes after the history fix: anti-firefly, then the fast history.
//
// Paper    NRD documentation: anti-firefly and fast history.  Anti-firefly: mean and deviation of the fast history of 9x9
//          pixels without the 3x3 in the center.  Fast history: those of 5x5 pixels limit the long history, the more the longer
//          it is.   Reference  references.reuse_methods.Reblur
// Departs  Pixels of the sky have no part in either.

// Of the fast history of a square of pixels, relative to its first, so that float32 is precise enough.  A hole of -1 is none; no
// pixels limit nothing.
void fast_range(ivec2 p, int reach, int hole, out vec2 mean, out vec2 sigma) {
    vec2 origin = vec2(0.0), first = vec2(0.0), second = vec2(0.0);
    float n = 0.0;
    for (int y = -reach; y <= reach; ++y)
        for (int x = -reach; x <= reach; ++x) {
            ivec2 q = p + ivec2(x, y);
            if (max(abs(x), abs(y)) <= hole || !in_image(q) || !(fetch_position(q).w > 0.0)) continue;
            if (n == 0.0) origin = fetch_fast_now(q);
            vec2 d = fetch_fast_now(q) - origin;
            first += d;
            second += d * d;
            n += 1.0;
        }
    mean = first / max(n, 1.0);
    sigma = n > 0.0 ? sqrt(max(second / n - mean * mean, 0.0)) : vec2(1.0e30);
    mean += origin;
}

void reuse(ivec2 p) {
    vec4 light[2] = vec4[2](fetch_diffuse_now(p), fetch_specular_now(p));
    vec2 fast = fetch_fast_now(p), before = max(fetch_count(p) - 1.0, 0.0);
    if (fetch_position(p).w > 0.0) {
        vec2 mean, sigma;
        vec2 lit = vec2(luminance(light[0].rgb), luminance(light[1].rgb)), limited = lit;
        if (anti_firefly) {
            fast_range(p, 4, 1, mean, sigma);
            limited = clamp(limited, mean - firefly_sigma * sigma, mean + firefly_sigma * sigma);
        }
        vec2 reconstructed = limited;
        fast_range(p, 2, -1, mean, sigma);
        vec2 inner = clamp(limited, mean - fast_sigma * sigma, mean + fast_sigma * sigma);
        if (fast_frames < max_frames) limited = mix(inner, limited, 1.0 / (1.0 + 2.0 * before));
        for (int lobe = 0; lobe < 2; ++lobe) {
            if (lit[lobe] > 0.0) light[lobe].rgb *= limited[lobe] / lit[lobe];
            float kept = clamp(before[lobe] / max(float(fix_frames), 1.0e-6), 0.0, 1.0);
            fast[lobe] = mix(reconstructed[lobe], fast[lobe], kept);
        }
    }
    write_diffuse_now(p, light[0]);
    write_specular_now(p, light[1]);
    write_fast(p, fast);
}
