"""Runs commands in forked children of one process that has imported the program once, with limits and an audit.

``python hostile_server.py``: each line of input is one case (JSON: ``command``, ``folder``, ``named``), each line of
output what happened: ``code`` (of the exit, negative: the signal), ``bytes`` (most memory), ``printed``, ``errors``
(text) and ``touched``: files outside the case's output that it opened to write, renamed or removed, and foreign ones
that it read.
"""

from __future__ import annotations

import contextlib
import json
import os
import pkgutil
import resource
import select
import signal
import sys
import traceback
from pathlib import Path
from typing import Any

SECONDS = 30  # of processor time
PATIENCE = 8 * SECONDS  # of a case that waits, or of a busy machine
ADDRESSES = 8 << 30  # bytes; llvmpipe's own code and stacks take two gigabytes
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = {"os.rename": 2, "os.remove": 1, "os.rmdir": 1, "os.mkdir": 1, "os.link": 2, "os.symlink": 2,
           "os.truncate": 1, "os.chmod": 1, "os.chown": 1, "os.utime": 1}  # fmt: skip
"""Audit events -> how many of their first arguments are paths that change."""


def scene(path: str) -> None:
    """Load a scene, and pose it at a few times."""
    import numpy as np

    from taubench_gl.animation.pose import sample
    from taubench_gl.scene import load_scene

    loaded = load_scene(path)
    with np.errstate(all="ignore"):
        for seconds in (0.0, 0.3, loaded.duration):
            sample(loaded, seconds)


def evaluate(path: str) -> None:
    """Evaluate a few frames of a scene with light; the classes of every pair add up."""
    import numpy as np

    from taubench_gl.evaluation import evaluate_scene
    from taubench_gl.metrics.counts import CLASSES
    from taubench_gl.settings import FIXED_LIGHTING, Settings

    settings = Settings(
        width=24, height=16, fps=4, frames=(0, 3), reprojection="motion", shadow_size=32, light="raster",
        columns=("frustum", "position", "normal", "direct", "color"), **FIXED_LIGHTING,
    )  # fmt: skip
    with np.errstate(all="ignore"):
        run = evaluate_scene(path, settings)
    for row in run.frames:
        assert sum(row[name] for name in CLASSES) == row["pixels"] == 24 * 16, row


CALLS = {
    "@preset": "taubench_gl.preset:load_preset", "@scene": "__main__:scene", "@evaluate": "__main__:evaluate",
    "@spec": "taubench_gl.batch.spec:read_spec", "@suite": "taubench_gl.benchmark.suite:read_suite",
}  # fmt: skip
"""Command of a case -> the function of a path that it calls."""


def audit(folder: Path, named: str, report: int) -> None:
    """Report writes outside the case's output, and reads of foreign files that the command does not name."""
    foreign, real_named = os.path.realpath(folder / "foreign"), os.path.realpath(named)
    caches = (os.environ[name] for name in ("NUMBA_CACHE_DIR", "MESA_SHADER_CACHE_DIR", "MPLCONFIGDIR"))
    allowed = (str(folder / "out"), str(folder / "own"), *caches)
    devices = ("/dev/null", "/dev/dri", "/dev/tty", "/dev/shm")

    def within(path: str, roots: tuple[str, ...]) -> bool:
        return any(
            path == root
            or path.startswith((root + "/", root + ".", f"{os.path.dirname(root)}/.{os.path.basename(root)}."))
            for root in roots
        )

    def text(path: Any) -> str | None:
        if isinstance(path, int) or path is None:
            return None
        path = os.fsdecode(path)
        # Relative names are those of files in an open folder; the working folder is empty, and compared afterwards.
        return os.path.realpath(path) if os.path.isabs(path) else None

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        found: list[str] = []
        if event == "open":
            path, flags = text(arguments[0]), arguments[2]
            if path is None:
                return
            if isinstance(flags, int) and flags & WRITING and not within(path, (*allowed, *devices)):
                found = [f"open to write {path}"]
            elif within(path, (foreign, "/etc/passwd")) and path != real_named:
                found = [f"read {path}"]
        elif event in CHANGES:
            paths = [text(a) for a in arguments[: CHANGES[event]]]
            if event == "os.symlink":
                paths = paths[1:]
            found = [f"{event} {path}" for path in paths if path and not within(path, allowed)]
        for one in found:
            os.write(report, (json.dumps(one) + "\n").encode())

    sys.addaudithook(hook)


def child(case: dict[str, Any], printed: int, errors: int, report: int) -> None:
    """The case in a forked process; never returns."""
    code = 1
    try:
        folder = Path(case["folder"])
        (folder / "own" / "tmp").mkdir(parents=True)
        os.environ |= {"TMPDIR": str(folder / "own" / "tmp"), "HOME": str(folder / "own"),
                       "TAUBENCH_CACHE": str(folder / "own" / "cache"), "TAUBENCH_MAX_MEMORY": "1GiB"}  # fmt: skip
        os.chdir(folder / "own" / "tmp")
        os.dup2(printed, 1)
        os.dup2(errors, 2)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 2))
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        audit(folder, case["named"], report)
        code = run(case["command"])
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def run(command: list[str]) -> int:
    from taubench_gl.apps import cli
    from taubench_gl.errors import TaubenchError

    if call := CALLS.get(command[0]):
        try:
            pkgutil.resolve_name(call)(command[1])
        except TaubenchError as error:
            print(f"taubench-gl: error: {error}", file=sys.stderr)
            return 2
        return 0
    try:
        cli.main(command)
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)


def serve(case: dict[str, Any]) -> dict[str, Any]:
    files = {name: os.memfd_create(name) for name in ("printed", "errors", "report")}
    pid = os.fork()
    if pid == 0:
        os.setpgid(0, 0)
        child(case, *files.values())
    handle = os.pidfd_open(pid)
    ended, _, _ = select.select([handle], [], [], PATIENCE)
    if not ended:
        os.kill(pid, signal.SIGKILL)
    _, status, usage = os.wait4(pid, 0)
    with contextlib.suppress(ProcessLookupError, PermissionError):  # what it has started
        os.killpg(pid, signal.SIGKILL)
    os.close(handle)
    texts = {}
    for name, file in files.items():
        texts[name] = os.pread(file, 1 << 20, 0).decode("utf-8", "surrogateescape")
        os.close(file)
    return {
        "code": os.waitstatus_to_exitcode(status),
        "hung": not ended,
        "bytes": usage.ru_maxrss * 1024,
        "seconds": usage.ru_utime + usage.ru_stime,
        "printed": texts["printed"],
        "errors": texts["errors"],
        "touched": [json.loads(line) for line in texts["report"].splitlines()],
    }


def main() -> None:
    import taubench_gl.api
    import taubench_gl.apps.cli
    import taubench_gl.benchmark.suite
    import taubench_gl.evaluation.pairs
    import taubench_gl.pathtraced.compare
    import taubench_gl.report.run_page  # noqa: F401  (all before the first fork; none of them opens OpenGL)

    for line in sys.stdin:
        print(json.dumps(serve(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
