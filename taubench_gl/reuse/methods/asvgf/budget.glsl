// The light that is new in this frame, with the color of its surface and without emission: that of the gradient sample where
// there is one, else that of the pixel.  So no pixel costs more samples than without gradients.
//
// Paper    Schied, Peters, Dachsbacher 2018: gradient samples are a subset of the samples of the frame.
// Reference references.reuse_methods.gradient_budget
// Departs  The sample is at its own surface point, up to half a pixel from the center of the pixel, whose geometry and albedo
//          are used with it; the paper overwrites these too.
void reuse(ivec2 p) {
    bool again = gradient_budget && fetch_reshaded(p).a > 0.5;
    vec3 light = fetch_radiance(p).rgb - frame.exposure * fetch_emission(p).rgb;
    write_sampled_light(p, vec4(again ? fetch_reshaded(p).rgb : light, 1.0));
    write_sampled_direct(p, vec4(again ? fetch_reshaded_direct(p).rgb : fetch_direct(p).rgb, 1.0));
}
