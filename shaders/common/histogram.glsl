// Log-linear histogram bin of a distance >= 0, cut from the bits of the float (reference: metrics.counts.bin_of).
// Bin 0 holds everything below 2^-20; the last bin 2^12 and above, +Inf included.
uint histogram_bin(float distance) {
    uint key = floatBitsToUint(distance) >> (23 - HISTOGRAM_MANTISSA_BITS);
    uint first = uint(127 + HISTOGRAM_MIN_EXPONENT) << HISTOGRAM_MANTISSA_BITS;
    return key < first ? 0u : min(key - first + 1u, uint(HISTOGRAM_BINS - 1));
}
