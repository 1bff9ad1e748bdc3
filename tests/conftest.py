"""Shared fixtures: the folder of real scenes, which is only read, the GL context, a display, and browsers."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import io
import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from fixed import FIXED
from page_tools import opened

if TYPE_CHECKING:
    from taubench_gl.gpu.context import Gpu


os.environ.setdefault("TAUBENCH_STAGE_SECONDS", "3600")  # which stages are lines would depend on the load
gc.disable()  # while tests are collected, where nothing becomes garbage: a fifth of that time
if "PYTEST_XDIST_WORKER" in os.environ:
    atexit.register(os._exit, 0)  # after all other handlers: freeing what a worker has made would take 2 s
else:
    atexit.register(gc.unfreeze)  # some libraries report what then is left


def _long() -> dict[str, int]:
    """Entries of tests/long.txt: test -> 0, or function -> n where each n-th of its cases stays in the usual run."""
    text = Path(__file__).with_name("long.txt").read_text(encoding="utf-8")
    entries = (line.rpartition(" /") for line in text.splitlines())
    return {name or number: int(number) if name else 0 for name, _, number in entries}


@pytest.hookimpl(tryfirst=True)  # before marks select
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    long, cases = _long(), Counter[str]()
    for item in items:
        function = item.nodeid.partition("[")[0]
        step = long.get(function, 0)
        if long.get(item.nodeid) == 0 or (step and cases[function] % step):
            item.add_marker("long")
        cases[function] += 1


def pytest_collection_finish() -> None:
    """From here on garbage is collected, rarely, without a look at what collecting the tests has made."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(100_000)


def _shared_data() -> Path | None:
    """Folder of third-party scenes: TAUBENCH_DATA, else shared/data beside the checkout."""
    candidates = [os.environ.get("TAUBENCH_DATA"), Path(__file__).resolve().parents[2] / "shared" / "data"]
    for candidate in candidates:
        if candidate and Path(candidate).is_dir():
            return Path(candidate)
    return None


DATA = _shared_data()


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of real scenes; tests that need it are skipped without it."""
    if DATA is None:
        pytest.skip("no folder of real scenes; set TAUBENCH_DATA")
    return DATA


@pytest.fixture(scope="session")
def session_gpu() -> Gpu:
    from taubench_gl.gpu.context import open_gpu

    return open_gpu()


@pytest.fixture
def gpu(session_gpu: Gpu) -> Iterator[Gpu]:
    """The current GL context; the test fails on a GL error."""
    with session_gpu:
        assert session_gpu.ctx.error == "GL_NO_ERROR"
        yield session_gpu
        session_gpu.check("the test")


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Headless Chromium; skips where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def display() -> Iterator[dict[str, str]]:
    """Environment with an X display of its own."""
    pytest.importorskip("glfw", reason="the viewer extra is not installed")
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            number = answer.readline().strip()  # waits until the server is ready; empty where it ended instead
        if not number:
            pytest.skip("Xvfb does not start")
        yield {**os.environ, "DISPLAY": f":{number}", "LP_NUM_THREADS": "1"}
    finally:
        server.terminate()
        server.wait()


FIREFOX = next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None)


def _end_with_parent() -> None:
    """Linux: the kernel kills this process when its parent ends, however that ends."""
    ctypes.CDLL(None).prctl(1, int(signal.SIGKILL))  # PR_SET_PDEATHSIG


@pytest.fixture(scope="session")
def session_firefox(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Headless Firefox, driven by Marionette; skips where there is none."""
    marionette = pytest.importorskip("marionette_driver.marionette", reason="marionette_driver is not installed")
    if FIREFOX is None or not sys.platform.startswith("linux"):
        pytest.skip("no Firefox on this machine")
    folder, port = tmp_path_factory.mktemp("firefox"), marionette.Marionette.check_port_available(0)
    (folder / "user.js").write_text(f'user_pref("marionette.port", {port});\n')
    # System access: to read the messages of the console.
    command = [FIREFOX, "--headless", "--marionette", "--remote-allow-system-access", "--no-remote"]
    with open(folder / "log.txt", "wb") as log:
        process = subprocess.Popen(
            [*command, "--profile", folder], stdout=log, stderr=subprocess.STDOUT, preexec_fn=_end_with_parent
        )
    driver = marionette.Marionette(port=port)
    try:
        driver.raise_for_port(timeout=120, check_process_status=False)
        driver.start_session()
        driver.set_window_rect(width=1280, height=900)
        yield driver
        driver.delete_session()
    finally:
        process.kill()
        process.wait()


CONSOLE_ERRORS = """const errors = [];
for (const message of Services.console.getMessageArray()) {
  if (!(message instanceof Ci.nsIScriptError) || message.flags & Ci.nsIScriptError.warningFlag) continue;
  if (message.sourceName.startsWith("file:")) errors.push(`${message.sourceName}: ${message.errorMessage}`);
}
Services.console.reset();
return errors;"""
"""Exceptions and broken security policies of pages; forgets all messages."""


@pytest.fixture
def firefox(session_firefox: Any) -> Iterator[Callable[[Path, str], Any]]:
    """firefox(file, selector) -> driver with the page, once it has the element; fails on errors of the console.

    Scripts given to the driver see elements, not the names that the page's scripts declare.
    """
    from marionette_driver import By, Wait

    driver = session_firefox

    def console_errors() -> list[str]:
        with driver.using_context(driver.CONTEXT_CHROME):
            return driver.execute_script(CONSOLE_ERRORS)

    def open_page(file: Path, selector: str) -> Any:
        driver.navigate(file.as_uri())
        Wait(driver, timeout=60).until(lambda d: d.find_elements(By.CSS_SELECTOR, selector))
        return driver

    console_errors()
    yield open_page
    driver.navigate("about:blank")  # pages that play take time from other tests
    assert console_errors() == []


@pytest.fixture
def both_browsers(browser: Any, firefox: Callable[[Path, str], Any]) -> Callable[[Path, str], None]:
    """both_browsers(file, selector) opens a page in Chromium and in Firefox and waits for the element.

    Fails on an error of the console, on an exception and, in Chromium, on a warning, on a missing file and on a request
    to the network.
    """

    def open_page(file: Path, selector: str = "main") -> None:
        for page in opened(browser, file):
            page.wait_for_selector(selector, state="attached")
        firefox(file, selector)

    return open_page


@contextlib.contextmanager
def _lighting_defaults(**values: Any) -> Iterator[None]:
    """Inside, settings made in this process have ``values`` unless they name others."""
    from taubench_gl.settings import LightingSettings

    init = LightingSettings.__init__
    names, before = init.__code__.co_varnames[1 : init.__code__.co_argcount], init.__defaults__
    init.__defaults__ = tuple(values.get(name, default) for name, default in zip(names, before, strict=True))
    try:
        yield
    finally:
        init.__defaults__ = before


@pytest.fixture(scope="module")
def fixed_light() -> Iterator[None]:
    """FIXED light for modules that give no settings themselves, because they run commands or studies."""
    with _lighting_defaults(**FIXED):
        yield


@pytest.fixture(scope="module")
def coarse_light() -> Iterator[None]:
    """Fixed light of few texels and probes, for modules whose subject is not its accuracy."""
    with _lighting_defaults(**{**FIXED, "shadow_size": 64, "probes": 32}):
        yield


@pytest.fixture
def taubench(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[Any, str, str]]:
    """Runs the command line in this process: arguments -> (exit code, stdout, stderr)."""
    from taubench_gl.apps import cli

    monkeypatch.delenv("TAUBENCH_DEBUG", raising=False)
    monkeypatch.delenv("TAUBENCH_BACKEND", raising=False)

    def run(*arguments: str | Path) -> tuple[Any, str, str]:
        with pytest.raises(SystemExit) as exit_:
            cli.main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return exit_.value.code, out, err

    return run


@pytest.fixture(scope="module")
def coarse_metering(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Exposures from few pixels of three frames, for modules whose subject is another; their cache is their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("taubench_gl.evaluation.exposure.METERED_PIXELS", 512)
        patch.setattr("taubench_gl.evaluation.exposure.METERED_FRAMES", 3)
        patch.setenv("TAUBENCH_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def coarse_space() -> Iterator[None]:
    """An eighth of the voxels in which cameras find free space, and points for them."""
    from taubench_gl.datasets.free_space import SAMPLES, VOXELS, VoxelSpace, surface_points

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VoxelSpace.__init__, "__defaults__", (VOXELS // 8,))
        patch.setattr(surface_points, "__defaults__", (SAMPLES // 4,))
        yield


class Programs:
    """Programs that evaluations share by their texts: compiling them would take a fifth of the tests that evaluate."""

    shared = True

    def __init__(self, compiled: Callable[..., Any]) -> None:
        self._compile = compiled
        self._made: dict[tuple[Any, ...], tuple[Any, Any]] = {}  # id of a context, texts -> the context, the program

    def compiled(self, cache: Any, *sources: Any) -> Any:
        if not self.shared:
            return self._compile(cache, *sources)
        key = (id(cache._ctx), *(source.text for source in sources))
        if key not in self._made:
            self._made[key] = cache._ctx, self._compile(cache, *sources)
        return self._made[key][1]

    def release(self, cache: Any) -> None:
        kept = {id(program) for _, program in self._made.values()}
        for program in cache._programs.values():
            if id(program) not in kept:
                program.release()
        cache._programs.clear()


@pytest.fixture(scope="session", autouse=True)
def _programs() -> Iterator[Programs]:
    from taubench_gl.gpu.shader import ShaderCache

    programs = Programs(ShaderCache._compiled)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ShaderCache, "_compiled", lambda cache, *sources: programs.compiled(cache, *sources))
        patch.setattr(ShaderCache, "release", lambda cache: programs.release(cache))
        yield programs


@pytest.fixture
def own_programs(_programs: Programs, monkeypatch: pytest.MonkeyPatch) -> None:
    """Evaluations of this test compile and free their own programs."""
    monkeypatch.setattr(_programs, "shared", False)


def _no_picture() -> dict[str, bytes]:
    """Files of one pixel and of nothing, by suffix."""
    from PIL import Image

    data = io.BytesIO()
    Image.new("RGB", (1, 1)).save(data, "png")
    return {".png": data.getvalue(), ".svg": b'<svg xmlns="http://www.w3.org/2000/svg"/>\n'}


NO_PICTURE = _no_picture()


@pytest.fixture(scope="session", autouse=True)
def _drawn_plots() -> Iterator[Callable[..., list[Path]]]:
    """Drawing the text of plots would take a twentieth of all tests.  Yields what draws them."""
    from taubench_gl.outputs import write_atomically
    from taubench_gl.report.plot import Plot

    def save(self: Plot, path: Path) -> list[Path]:
        files = [path.with_suffix(suffix) for suffix in NO_PICTURE]
        for file in files:
            write_atomically(file, NO_PICTURE[file.suffix])
        return files

    drawn = Plot.save
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Plot, "save", save)
        yield drawn


@pytest.fixture
def plots(_drawn_plots: Callable[..., list[Path]], monkeypatch: pytest.MonkeyPatch) -> None:
    """Plots are drawn in this test; in all others they are composed, and their files hold no picture."""
    monkeypatch.setattr("taubench_gl.report.plot.Plot.save", _drawn_plots)
