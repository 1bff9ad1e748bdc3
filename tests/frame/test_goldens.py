"""Images against goldens that were inspected when made (tools/make_goldens.py), on the renderer that made them.

A missing golden fails: nothing here writes one.
"""

from __future__ import annotations

import numpy as np
import pytest
from golden_cases import CASES, FOLDER, golden_file, render, scene_path

SHARE = 0.002  # of the pixels, at most: other versions of llvmpipe round differently on edges


@pytest.mark.parametrize("name", list(CASES))
def test_golden(gpu, data, name: str) -> None:
    file = golden_file(name)
    assert file.is_file(), f"no golden for {name}: look at what tools/make_goldens.py --sheet draws, then commit it"
    golden = np.load(file)
    made_on = str(golden["renderer"])
    if made_on.split()[0] not in gpu.renderer:
        pytest.skip(f"goldens are of {made_on}, this is {gpu.renderer}")
    images = render(gpu, scene_path(data, name), CASES[name])
    differ = (images["ids"] != golden["ids"]).any(axis=-1)
    assert differ.mean() <= SHARE, f"{differ.sum()} pixels show something else"
    same = ~differ
    depth, expected = images["depth"].astype(float), golden["depth"].astype(float)
    assert (np.abs(depth - expected)[same] > 2e-3 * expected[same] + 1e-6).mean() <= SHARE
    for channel, step in (("normal", 2), ("base_color", 2)):
        off = np.abs(images[channel].astype(int) - golden[channel].astype(int)).max(axis=-1)
        assert (off[same] > step).mean() <= SHARE, channel
    words = images["mask"] != golden["mask"]
    assert words.mean() <= SHARE, f"{words.sum()} reason words differ"


def test_goldens_are_those_of_the_cases() -> None:
    assert {p.name for p in FOLDER.glob("*.npz")} == {golden_file(n).name for n in CASES}
