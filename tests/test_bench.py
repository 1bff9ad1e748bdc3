"""The modules behind tools/bench: ratios, fitted powers, tables, and missing peers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))


def test_ratios_are_relative_to_the_base_row() -> None:
    from benches import Result, cells, missing, row, with_ratios

    rows = [row("a", [2.0, 2.0]), row("b", [6.0, 6.0]), missing("c", "not installed")]
    given = with_ratios(Result("t", rows, [], base=0)).rows
    assert [r.ratio for r in given] == [1.0, 3.0, None]
    assert [r.ratio for r in with_ratios(Result("t", rows, [], base=1)).rows][:2] == [1 / 3, 1.0]
    assert [r.ratio for r in with_ratios(Result("t", rows, [], base=-1)).rows] == [None] * 3
    assert [r.ratio for r in with_ratios(Result("t", rows[::-1], [], base=0)).rows] == [None] * 3  # no base, no ratio
    assert cells(given[2]) == ["c: not installed", "–", "–", "–", "–", "0"]
    assert cells(given[1])[:3] == ["b", "3", "6.00"]


def test_a_power_law_is_fitted_exactly() -> None:
    from scaling_benches import fit

    counts = [1.0, 2.0, 5.0, 9.0]
    assert np.allclose(fit(counts, [3.0 * c**0.75 for c in counts]), 0.75)
    mixed = [1.0 + c**2 for c in (0.01, 0.1, 10.0, 100.0)]  # a fixed cost first, a square later
    whole, upper = fit([0.01, 0.1, 10.0, 100.0], mixed)
    assert whole < 1.5 < upper < 2.01


@pytest.mark.parametrize("why", ["no interpreter", "no module", "an error", "an exit"])
def test_a_peer_that_cannot_start_is_missing_with_a_reason(why: str, monkeypatch, tmp_path: Path) -> None:
    import peers

    program = tmp_path / "program.py"
    body = {
        "no module": "import nowhere_at_all",
        "an error": "raise OSError('the disk is full')",
        "an exit": "import os; os._exit(3)",
    }
    program.write_text(
        f"import sys; sys.path.insert(0, {str(peers.PROGRAMS)!r})\n"
        "from serve import serve\n"
        f"def prepare():\n    {body.get(why, 'pass')}\n"
        "serve(prepare)\n"
    )
    monkeypatch.setattr(peers, "PROGRAMS", tmp_path)
    peer = peers.Peer.start("program.py", python=str(tmp_path / "python") if why == "no interpreter" else None)
    named = {
        "no interpreter": str(tmp_path), "no module": "nowhere_at_all", "an error": "the disk is full", "an exit": "3",
    }  # fmt: skip
    assert named[why] in peer.missing
    peer.close()


def test_a_peer_answers_and_reports_errors_and_exits(monkeypatch, tmp_path: Path) -> None:
    import peers

    (tmp_path / "program.py").write_text(
        f"import sys; sys.path.insert(0, {str(peers.PROGRAMS)!r})\n"
        "from serve import serve\n"
        "def prepare():\n"
        "    print('output of libraries is not an answer')\n"
        "    def answer(request):\n"
        "        if isinstance(request['x'], str): import os; os._exit(4)\n"
        "        return {'y': request['x'] * 2}\n"
        "    return answer, {'version': '1'}\n"
        "serve(prepare)\n"
    )
    monkeypatch.setattr(peers, "PROGRAMS", tmp_path)
    peer = peers.Peer.start("program.py")
    assert peer.missing is None and peer.hello == {"version": "1"}
    assert np.array_equal(peer.ask(x=np.arange(3))["y"], [0, 2, 4])
    with pytest.raises(RuntimeError, match="TypeError"):
        peer.ask(x=None)
    assert peer.ask(x=4)["y"] == 8
    with pytest.raises(RuntimeError, match="code 4"):
        peer.ask(x="end")
    peer.close()


@pytest.mark.parametrize("reader", ["json", "pygltflib"])
@pytest.mark.parametrize("name", ["demo.glb", "demo.gltf"])
def test_readers_open_both_kinds_of_file(reader: str, name: str, tmp_path: Path) -> None:
    import peers
    from pygltflib import GLTF2

    GLTF2().load(ROOT / "assets" / "demo.glb").save(tmp_path / name)
    peer = peers.Peer.start("load_scene.py", reader, str(tmp_path / name))
    assert peer.missing is None and peer.hello["load_ms"] > 0
    peer.close()


def test_pyrender_draws_a_scene_with_a_node_scaled_to_nothing() -> None:
    pytest.importorskip("pyrender")
    import peers

    peer = peers.Peer.start("pyrender_frames.py", str(ROOT / "assets" / "demo.glb"), "64", "36")
    world_from_view = np.eye(4)
    world_from_view[:3, 3] = 0.0, 2.0, 12.0
    assert 0.3 < peer.ask(world_from_view=world_from_view, yfov=0.8, znear=0.1, zfar=100.0)["covered"] <= 1.0
    peer.close()


@pytest.mark.long
def test_missing_peers_are_reported_in_the_table(tmp_path: Path) -> None:
    """Without Blender and PyTorch the command succeeds and its files give the reasons."""
    bare = {**os.environ, "TAUBENCH_TORCH_PYTHON": str(tmp_path / "none"), "TAUBENCH_DATA": str(tmp_path)}
    command = [
        sys.executable,
        ROOT / "tools" / "bench",
        "masks",
        "--no-install",
        "--size",
        "64x36",
        "--repeats",
        "1",
        "--out",
        tmp_path,
    ]
    done = subprocess.run(command, capture_output=True, text=True, env=bare)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "bench.md").read_text()
    assert "PyTorch grid_sample: " in text and "does not run" in done.stdout
    written = json.loads((tmp_path / "bench.json").read_text())
    numpy = [claim for claim in written["claims"] if claim["what"].endswith("faster than NumPy")]
    assert len(numpy) == 2 and all(claim["measured"] > 0 and claim["target"] == 5 for claim in numpy)
    assert text.index("## Claims") < text.index("## Masks against")


def test_claims_hold_fail_or_are_not_measured() -> None:
    from benches import Claim, claim_cells, claim_lines, unmeasured

    fast, slow = Claim("a", ">=", 5.0, 5.0, 4.0, 6.0), Claim("b", "<=", 0.3, 0.31, note="at 4x4")
    absent = unmeasured("c", ">=", 30.0, "no bpy")
    assert [c.holds for c in (fast, slow, absent)] == [True, False, None]
    assert claim_cells(fast) == ["a", ">= 5 x", "5 x", "4 to 6", "yes"]
    assert claim_cells(slow) == ["b (at 4x4)", "<= 0.3 x", "0.31 x", "–", "NO"]
    assert claim_cells(absent) == ["c (no bpy)", ">= 30 x", "–", "–", "not measured"]
    assert len(claim_lines([fast, slow, absent])) == 5


def test_ratios_of_interleaved_measurements() -> None:
    from benches import ratios

    ratio, low, high = ratios([2.0, 4.0, 6.0], [1.0, 2.0, 3.0])  # a machine that slows down slows both
    assert ratio == low == high == 2.0
    ratio, low, high = ratios([1.0, 1.0, 10.0], [1.0, 1.0, 1.0])
    assert ratio == 1.0 and low == 1.0 and high > 8.0
