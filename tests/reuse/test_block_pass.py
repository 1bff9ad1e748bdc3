"""Block passes: one call per block, shared memory, and a grid that covers the image with any shift."""

from __future__ import annotations

import numpy as np
import pytest
from reuse_tools import play, still_steps, write_method

SIZE = (45, 27)
TOML = """
reads = ["radiance"]
[settings]
shift = {{ default = 0, min = 0, max = 63, doc = "pixels" }}
[[pass]]
shader = "a.glsl"
writes = ["result"]
block = [{0}, {1}]
"""
MEANS = """
// Every pixel of a block gets the mean of the pixels of the block that are in the image.
shared vec4 sums[block_threads];
void reuse_block(ivec2 block, int thread) {
    ivec2 origin = block * block_size - shift;
    int pixels = block_size.x * block_size.y;
    vec4 sum = vec4(0.0);
    for (int i = thread; i < pixels; i += block_threads) {
        ivec2 p = origin + ivec2(i % block_size.x, i / block_size.x);
        if (in_image(p)) sum += vec4(fetch_radiance(p).rgb, 1.0);
    }
    sums[thread] = sum;
    for (int width = block_threads / 2; width > 0; width /= 2) {
        barrier();
        if (thread < width) sums[thread] += sums[thread + width];
    }
    barrier();
    for (int i = thread; i < pixels; i += block_threads) {
        ivec2 p = origin + ivec2(i % block_size.x, i / block_size.x);
        if (in_image(p)) write_result(p, sums[0].rgb / sums[0].a);
    }
}
"""


@pytest.mark.parametrize("block", [(8, 8), (32, 16)])
@pytest.mark.parametrize("shift", [0, 7])
def test_block_means(gpu, tmp_path, block, shift):
    """Against NumPy; y of a method points up."""
    rng = np.random.default_rng(1)
    image = rng.random((SIZE[1], SIZE[0], 3))
    folder = write_method(tmp_path / "m", TOML.format(*block), a=MEANS)
    got = play(gpu, folder, still_steps(SIZE, [image]), {"shift": shift})[0][..., :3]
    up, column = np.mgrid[SIZE[1] - 1 : -1 : -1, : SIZE[0]]
    number = (up + shift) // block[1] * 1000 + (column + shift) // block[0]
    expected = np.zeros_like(image)
    for one in np.unique(number):
        expected[number == one] = image[number == one].mean(axis=0)
    assert len(np.unique(number)) >= 4
    np.testing.assert_allclose(got, expected, atol=1e-6)
