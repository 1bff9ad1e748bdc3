"""Scene names that are not valid UTF-8, in the table of all pairs."""

from __future__ import annotations

import io
import os

import pytest

from taubench_gl.batch.merge import frames_table
from taubench_gl.run_schema import FRAME_COLUMNS

pq = pytest.importorskip("pyarrow.parquet")


def test_names_that_are_not_utf8_are_escaped():
    lost = os.fsdecode(b"caf\xe9")
    row = dict.fromkeys(FRAME_COLUMNS, 0)
    data = frames_table([("job", lost, {"camera": lost, "fps": 24.0}, [row])])
    table = pq.read_table(io.BytesIO(data)).to_pylist()
    assert [(r["scene"], r["sweep_camera"], r["sweep_fps"]) for r in table] == [(r"caf\udce9", r"caf\udce9", "24.0")]
