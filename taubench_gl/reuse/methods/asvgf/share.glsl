// Weight of the new frame, adapted by the temporal gradient: alpha' = (1 - lambda) alpha + lambda, with
// lambda = min(1, |gradient| / normalization).
//
// Paper    Schied, Peters, Dachsbacher 2018, control of the temporal accumulation factor.
// Reference references.reuse_methods.gradient_lambda, adaptive_weight
// Departs  alpha is max(1 / n, alpha) as in this project's SVGF.  The frames of the history are multiplied by
//          1 - lambda, so that the spatial variance estimate is used where little history is left.

float lambda_of(ivec2 p) {
    vec2 last = vec2((frame.size.xy + 2) / 3 - 1);
    vec4 g = sample_gradient(clamp((vec2(p) - 1.0) / 3.0, vec2(0.0), last)); // the center of block b is pixel 3 b + 1
    return g.y > 0.0 ? min(abs(g.x) / g.y, 1.0) : 0.0;
}

float frames_left(ivec2 p, float frames) { return (1.0 - lambda_of(p)) * frames; }

// Gradient samples are blended, not the input.
void report_input(ivec2 p) { write_blend_input(p, vec4(new_light(p) + frame.exposure * fetch_emission(p).rgb, 1.0)); }

float new_weight(ivec2 p, float frames, float least) { return mix(max(1.0 / (frames + 1.0), least), 1.0, lambda_of(p)); }
