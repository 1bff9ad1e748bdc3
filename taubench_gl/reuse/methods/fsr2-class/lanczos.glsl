// Lanczos kernel of two lobes: sinc(x) sinc(x / 2), |x| < 2.   Reference references.reuse_methods.lanczos2
float lanczos2(float x) {
    x = abs(x);
    if (x < 1.0e-3) return 1.0;
    if (x >= 2.0) return 0.0;
    float a = 3.14159265358979 * x;
    return 2.0 * sin(a) * sin(0.5 * a) / (a * a);
}
