"""Training windows of rendered and of exported frames: which frames and pixels they hold, and equal bits."""

from __future__ import annotations

import numpy as np
import pytest
from export_tools import DEMO, settings

from taubench_gl.conventions import Reason
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.export.dataset import ExportedFrames, RenderedFrames, TrainingWindows
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.option_groups import TrainingOptions

HEIGHT, WIDTH = 5, 7
SIZES = {"base_color": 4, "normal": 3, "depth": 1, "motion": 2, "clean_radiance": 4, "noisy0_radiance": 4}


def counted(numbers=range(3, 9), **more) -> RenderedFrames:
    """Frames whose values tell frame, row, column and component: n * 1000 + y * 100 + x * 10 + c."""
    frame, y, x = np.meshgrid(numbers, range(HEIGHT), range(WIDTH), indexing="ij")
    value = (1000 * frame + 100 * y + 10 * x)[..., None]
    out = {name: (value + np.arange(count)).astype(np.float32) for name, count in SIZES.items()}
    out |= {"mask": np.zeros((len(numbers), HEIGHT, WIDTH, 1), np.uint32), **more}
    return RenderedFrames(numbers, out)


def test_every_window_is_listed_once():
    data = TrainingWindows([counted(), counted(range(0, 3))], length=3)
    assert data.items == [(0, 3, 0), (0, 4, 0), (0, 5, 0), (0, 6, 0), (1, 0, 0)] and len(data) == 5
    assert TrainingWindows([counted()], length=3, stride=2).items == [(0, 3, 0), (0, 5, 0)]
    assert len(TrainingWindows([counted(range(0, 2))], length=3)) == 0


def test_a_window_has_consecutive_frames_and_the_pixels_of_its_crop():
    data = TrainingWindows([counted()], length=3, crop=(4, 2))
    places = set()
    for data.epoch in range(40):
        rows, columns = data.window(1)
        places.add((rows.start, columns.start))
        assert 0 <= rows.start <= HEIGHT - 2 and 0 <= columns.start <= WIDTH - 4
        item = data.arrays(1)
        for name, shape in {"noisy": 3, "clean": 3, "base_color": 4, "motion": 2, "reusable": 1}.items():
            assert item[name].shape == (3, shape, 2, 4) and item[name].dtype == np.float32
        for k in range(3):
            y, x = np.mgrid[rows, columns]
            np.testing.assert_array_equal(item["noisy"][k, 1], 1000 * (4 + k) + 100 * y + 10 * x + 1)
            np.testing.assert_array_equal(item["motion"][k, 1], item["base_color"][k, 1])
    assert len(places) > 12  # of 16


def test_places_depend_on_seed_epoch_and_item_only():
    one, two = (TrainingWindows([counted()], crop=(2, 2), seed=7) for _ in range(2))
    assert [one.window(k) for k in range(3)] == [two.window(k) for k in reversed(range(3))][::-1]
    other = TrainingWindows([counted()], crop=(2, 2), seed=8)
    assert [one.window(k) for k in range(3)] != [other.window(k) for k in range(3)]


def test_every_noisy_image_is_a_window():
    noisy = counted().channels["noisy0_radiance"]
    data = TrainingWindows([counted(noisy1_radiance=noisy + 5)], length=6)
    assert data.items == [(0, 3, 0), (0, 3, 1)]
    np.testing.assert_array_equal(data.arrays(0)["noisy"] + 5, data.arrays(1)["noisy"])


def test_history_is_reusable_where_geometry_does_not_discard_it():
    mask = np.zeros((6, HEIGHT, WIDTH, 1), np.uint32)
    mask[1:, 0, 0], mask[1:, 0, 1], mask[1:, 0, 2] = Reason.POSITION, Reason.DIRECT, Reason.OUTSIDE
    motion = counted().channels["motion"].copy()
    motion[2, 1, 1] = np.nan
    item = TrainingWindows([counted(mask=mask, motion=motion)], length=6).arrays(0)
    assert not item["reusable"][0].any()
    np.testing.assert_array_equal(item["reusable"][1:, 0, 0, :4], np.tile([0.0, 1.0, 0.0, 1.0], (5, 1)))
    np.testing.assert_array_equal(item["motion"][2, :, 1, 1], [0, 0])


@pytest.mark.parametrize(
    "given", [{"length": 0}, {"stride": 0}, {"crop": (8, 2)}, {"crop": (2, 0)}, {"features": ("albedo",)}]
)
def test_windows_that_there_are_not(given):
    with pytest.raises(SettingsError):
        TrainingWindows([counted()], **given)


def test_a_folder_without_an_export(tmp_path):
    with pytest.raises(OutputError):
        ExportedFrames(tmp_path)


def test_items_are_tensors():
    torch = pytest.importorskip("torch")
    data = TrainingWindows([counted()], length=2, crop=(3, 3))
    assert isinstance(data, torch.utils.data.Dataset)
    (batch, *_) = torch.utils.data.DataLoader(data, batch_size=4, shuffle=True)
    assert batch["noisy"].shape == (4, 2, 3, 3, 3) and batch["reusable"].dtype == torch.float32


@pytest.mark.parametrize("format", ["npz", "zarr", "exr"])
def test_stored_frames_are_those_that_are_rendered(tmp_path, monkeypatch, format):
    pytest.importorskip("zarr" if format == "zarr" else "numpy")
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    given = settings(width=24, height=16, light="raster", reprojection="motion", exposure=1.0, frames=(2, 5))
    light = {"input": "noisy", "seeds": 2, "reference": "max", "reference_samples": 2}
    rendered = RenderedFrames.render(DEMO, given, **light)
    channels = ("base_color", "normal", "depth", "motion", "mask")
    export_scene(DEMO, tmp_path / "out", given, ExportOptions(format, channels, training=TrainingOptions(**light)))
    stored = ExportedFrames(tmp_path / "out")
    assert (stored.numbers, stored.size, set(stored.names)) == (range(2, 5), (24, 16), set(rendered.names))
    ours, theirs = (TrainingWindows([frames], length=2, crop=(16, 8)) for frames in (rendered, stored))
    assert ours.items == theirs.items == [(0, 2, 0), (0, 2, 1), (0, 3, 0), (0, 3, 1)]
    for item in range(4):
        one, two = ours.arrays(item), theirs.arrays(item)
        assert one.keys() == two.keys() >= {"noisy", "clean", "motion", "reusable"}
        for name in one:
            np.testing.assert_array_equal(one[name], two[name], err_msg=name)
    assert not np.array_equal(ours.arrays(0)["noisy"], ours.arrays(1)["noisy"])
