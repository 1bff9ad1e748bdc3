"""tools/setup.sh on incomplete machines: every external command is a stub that logs its calls."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

PYTHON = """
case "$*" in
  "-c import pip") exit 0 ;;
  -VV) echo "Python 3.11.0 (stub)" ;;
  *gl_probe.py) [ -e "$STATE/gl" ] && exit 0; echo "EGL: libEGL.so.1 is not installed"; exit 1 ;;
  *meshoptimizer) [ ! -e "$STATE/no-compiler" ] ;;
  *"-m pip"*) [ ! -e "$STATE/no-network" ] ;;
esac
"""
APT = """
case "$*" in
  *update) touch "$STATE/lists" ;;
  *libosmesa6) [ -e "$STATE/has-osmesa" ] ;;
  *install*) [ -e "$STATE/lists" ] || exit 100; touch "$STATE/gl" ;;
esac
"""


class Machine:
    """A checkout with a stubbed environment on a stubbed system."""

    def __init__(self, folder: Path):
        self.state, self.bin, self.root = folder / "state", folder / "bin", folder / "checkout"
        for path in (self.state, self.bin, self.root / ".venv" / "bin"):
            path.mkdir(parents=True)
        shutil.copytree(ROOT / "tools", self.root / "tools")
        for name in ("pyproject.toml", "setup.py", "constraints.txt"):
            shutil.copy(ROOT / name, self.root / name)
        for name in ("cat", "sha256sum", "basename", "dirname", "env", "bash", "touch", "true"):
            os.symlink(shutil.which(name), self.bin / name)
        self.stub(self.root / ".venv" / "bin" / "python", PYTHON, "python")
        self.stub(self.bin / "apt-get", APT)
        self.stub(self.bin / "sudo", 'if [ ! -e "$STATE/sudo" ]; then exit 1; fi; shift; exec "$@"')
        self.user(1000)

    def stub(self, path: Path, body: str, name: str | None = None) -> None:
        log = f'echo "{name or path.name} $*" >> "$STATE/log"'
        path.write_text(f"#!{shutil.which('bash')}\n{log}\n{body}")
        path.chmod(0o755)

    def user(self, number: int) -> None:
        path = self.bin / "id"
        path.write_text(f"#!{shutil.which('bash')}\necho {number}\n")
        path.chmod(0o755)

    def has(self, *facts: str) -> None:
        for fact in facts:
            (self.state / fact).touch()

    def setup(self) -> subprocess.CompletedProcess[str]:
        (self.state / "log").write_text("")
        script = f"set -euo pipefail; source {self.root}/tools/setup.sh; echo ready"
        environment = {"PATH": str(self.bin), "STATE": str(self.state)}
        command = [str(shutil.which("bash")), "-c", script]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)

    def calls(self, program: str) -> list[str]:
        lines = (self.state / "log").read_text().splitlines()
        return [line.removeprefix(f"{program} ") for line in lines if line.startswith(f"{program} ")]

    def pip_calls(self) -> list[str]:
        return [call for call in self.calls("python") if "-m pip" in call]


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_a_failed_install_is_retried_and_a_finished_one_is_not(machine):
    machine.has("gl", "no-network")
    done = machine.setup()
    assert done.returncode == 2 and "pip" in done.stderr
    (machine.state / "no-network").unlink()
    assert machine.setup().stdout == "ready\n"
    editable = machine.pip_calls()[0]
    assert f"--constraint {machine.root}/constraints.txt" in editable and f"--editable {machine.root}[" in editable
    assert machine.setup().stdout == "ready\n"
    assert machine.pip_calls() == [] and machine.calls("apt-get") == []


def test_user_without_rights_gets_the_command(machine):
    done = machine.setup()
    assert done.returncode == 2 and "ready" not in done.stdout
    command = "sudo apt-get update && sudo apt-get install -y --no-install-recommends"
    assert f"{command} libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri\n" in done.stderr
    assert machine.calls("apt-get") == []


@pytest.mark.parametrize("way", ["root", "sudo"])
def test_missing_gl_is_installed_after_fetching_lists(machine, way):
    if way == "root":
        machine.user(0)
    else:
        machine.has("sudo")
    machine.has("has-osmesa")
    done = machine.setup()
    assert done.stdout == "ready\n", done.stderr
    calls = machine.calls("apt-get")
    assert ["update" in call for call in calls[:3]] == [False, True, False]
    assert ["libegl1" in call for call in calls[:3]] == [True, False, True]
    assert all("-qq" in call for call in calls) and "libosmesa6" in calls[3]
    assert "libosmesa6" not in done.stderr


def test_probe_agrees_with_what_the_package_opens():
    """The probe reports a backend as usable if and only if a context opens."""
    import sys

    from taubench_gl.gpu.capabilities import capability_report

    done = subprocess.run([sys.executable, ROOT / "tools" / "gl_probe.py"], capture_output=True, text=True, timeout=60)
    usable = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    opens = capability_report()["backends"]
    assert {name.lower(): why == "usable" for name, why in usable.items()} == {
        name: backend["usable"] for name, backend in opens.items()
    }
    assert done.returncode == 0
