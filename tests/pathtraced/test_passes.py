"""Pass mappings and conversion: pass names, axes, signs, lobes, sky, missing columns."""

from __future__ import annotations

import json

import numpy as np
import pytest
from exr_files import HEIGHT, WIDTH, blender_frame, planes, write

from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.exr import read_exr
from taubench_gl.pathtraced.passes import (
    LOBES,
    ChannelIndex,
    load_mapping,
    missing_columns,
    presets,
    read_frame,
)

LAYERS = ("ViewLayer", "View Layer.001", "a.b")


def frame_of(tmp_path, channels, *, mapping=None, lobes=(), **options):
    """The frame, and the missing columns, of a file with ``channels``."""
    image = read_exr(write(tmp_path / "frame_0001.exr", channels, **options))
    index = ChannelIndex(image.names, mapping if mapping is not None else load_mapping(None))
    return read_frame(image, index, lobes), missing_columns(index, lobes)


@pytest.mark.parametrize("modern", [False, True])
@pytest.mark.parametrize("parts", [False, True])
@pytest.mark.parametrize("layer", LAYERS)
def test_blender_layouts(tmp_path, modern, parts, layer):
    channels, expected = blender_frame(layer=layer, modern=modern)
    frame, missing = frame_of(tmp_path, channels, parts=parts, lobes=LOBES[:3])
    np.testing.assert_array_equal(frame.sky, expected["sky"])
    np.testing.assert_allclose(frame.position, expected["position"], atol=1e-5)
    np.testing.assert_array_equal(frame.normal, expected["normal"])
    np.testing.assert_allclose(frame.motion, expected["motion"], rtol=1e-6)
    np.testing.assert_array_equal(frame.combined, expected["combined"])
    for name in ("direct", "indirect"):
        np.testing.assert_allclose(frame.radiance[name], expected[name], rtol=1e-6)
    for lobe in LOBES[:3]:
        np.testing.assert_array_equal(frame.lobes[f"{lobe}_direct"], expected[f"{lobe}_direct"])
    assert missing == {}


def test_sum_of_lobes_is_combined_in_real_files(data):
    for name in ("sponza_man/sponza_man_f0012.exr", "sponza_man_b50_f0012.exr"):
        image = read_exr(data / "cycles" / name)
        frame = read_frame(image, ChannelIndex(image.names, load_mapping(None)))
        total = frame.radiance["direct"] + frame.radiance["indirect"] + frame.emission + frame.environment
        np.testing.assert_allclose(total, frame.combined, atol=1e-5)


@pytest.mark.parametrize(
    ("lost", "named"),
    [("Diffuse Direct", " DiffDir"), ("Glossy Color", " GlossCol"), ("Glossy", " GlossDir, GlossCol")],
)
def test_a_missing_pass_is_the_reason_of_its_column(tmp_path, lost, named):
    channels, _ = blender_frame(modern=True)
    frame, missing = frame_of(tmp_path, {k: v for k, v in channels.items() if lost not in k})
    assert "direct" not in frame.radiance and missing["direct"].endswith(named)
    assert ("indirect" in missing) == lost.startswith("Glossy")


def test_volume_passes_are_optional_and_added(tmp_path):
    channels, expected = blender_frame()
    fog = np.full((HEIGHT, WIDTH, 3), 0.25, dtype=np.float32)
    frame, missing = frame_of(tmp_path, channels | planes(fog, "ViewLayer.VolumeDir", "RGB"), lobes=("volume",))
    np.testing.assert_allclose(frame.radiance["direct"], expected["direct"] + 0.25, rtol=1e-6)
    np.testing.assert_array_equal(frame.lobes["volume_direct"], fog)
    assert list(missing) == ["volume_indirect"] and missing["volume_indirect"].split()[-1] == "VolumeInd"


def test_the_layer_with_most_passes_is_the_default(tmp_path):
    first, _ = blender_frame(layer="Full")
    second = {k: v for k, v in blender_frame(layer="Bare", seed=1)[0].items() if "Position" in k or "Combined" in k}
    image = read_exr(write(tmp_path / "a.exr", first | second))
    assert ChannelIndex(image.names, load_mapping(None)).layer == "Full"
    bare = ChannelIndex(image.names, load_mapping(None), "Bare")
    assert bare.channels("combined")[0] == "Bare.Combined.R" and "normal" not in bare
    with pytest.raises(PathTracedError):
        ChannelIndex(image.names, load_mapping(None), "Other")


def test_plain_rgb_and_z_at_the_root(tmp_path):
    channels, expected = blender_frame()
    flat = {k.removeprefix("ViewLayer.Combined."): v for k, v in channels.items() if "Combined" in k}
    frame, missing = frame_of(tmp_path, flat | {"Z": channels["ViewLayer.Depth.Z"]})
    np.testing.assert_array_equal(frame.combined, expected["combined"])
    np.testing.assert_array_equal(frame.sky, expected["sky"])
    assert frame.position is None and set(missing) == {"normal", "direct", "indirect"}


def test_a_file_without_position_and_depth_is_refused(tmp_path):
    with pytest.raises(PathTracedError) as error:
        frame_of(tmp_path, {c: np.ones((HEIGHT, WIDTH), np.float32) for c in "RGB"})
    assert error.value.where == str(tmp_path / "frame_0001.exr")


def test_sky_with_and_without_a_depth_pass_and_nan_which_is_no_sky(tmp_path):
    channels, expected = blender_frame()
    kept = {k: v for k, v in channels.items() if "Depth" not in k}
    np.testing.assert_array_equal(frame_of(tmp_path, kept)[0].sky, expected["sky"])  # all-zero positions
    for name in ("Position.X", "Depth.Z", "DiffDir.R"):
        channels[f"ViewLayer.{name}"][-1, 3] = np.nan
    frame, _ = frame_of(tmp_path, channels)
    assert not frame.sky[-1, 3] and np.isnan(frame.position[-1, 3]).any()
    assert np.isnan(frame.radiance["direct"][-1, 3, 0]) and np.isfinite(frame.radiance["direct"][-1, 3, 1])


def test_averaged_normals_are_normalized(tmp_path):
    channels, _ = blender_frame()
    channels["ViewLayer.Normal.Z"] *= 0.5
    lengths = np.linalg.norm(frame_of(tmp_path, channels)[0].normal, axis=-1)
    assert set(np.unique(lengths)) == {0.0, 1.0}


def test_mapping_files(tmp_path):
    _, expected = blender_frame()
    custom = {"up": "y", "passes": {"position": {"channels": ["a", "b", "c"]}}}
    path = tmp_path / "m.json"
    path.write_text(json.dumps(custom))
    named = dict(zip("abc", (np.ascontiguousarray(expected["position"][..., i], np.float32) for i in range(3))))
    frame, _ = frame_of(tmp_path, named, mapping=load_mapping(path))
    np.testing.assert_allclose(frame.position, expected["position"], rtol=1e-6)


def test_presets_load():
    for name in presets():
        assert "position" in load_mapping(name).passes
    names = ["dd.y.T", "pp.X", "pp.Y", "pp.Z", "my_image.R", "my_image.G", "my_image.B"]
    dotted = ChannelIndex(names, load_mapping("mitsuba"))
    assert dotted.channels("depth") == ("dd.y.T",) and dotted.channels("combined")[0] == "my_image.R"


def test_unreal_files(tmp_path):
    """Epic's names and values: centimeters, left-handed +Z up, motion around 0.5 of the screen."""
    _, expected = blender_frame()
    layer = "FinalImageMovieRenderQueue_"
    shaped = planes(100 * expected["position"][..., [0, 2, 1]], "FinalImageWorldPosition", "RGB")
    shaped |= planes(0.5 - expected["motion"] / [WIDTH, HEIGHT], f"{layer}MotionVectors", "RG")
    shaped |= {f"{layer}WorldDepth.R": np.full((HEIGHT, WIDTH), 250.0, np.float32)}
    shaped |= dict(zip("RGB", (np.full((HEIGHT, WIDTH), value, np.float32) for value in (0.1, 0.2, 0.3))))
    shaped |= {"ActorHitProxyMask00.R": np.zeros((HEIGHT, WIDTH), np.float32)}
    frame, _ = frame_of(tmp_path, shaped, mapping=load_mapping("unreal"))
    np.testing.assert_allclose(frame.position, expected["position"], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(frame.motion, expected["motion"], atol=1e-5)
    assert np.unique(frame.depth) == np.float32(2.5) and not frame.sky.any()
    assert frame.combined[0, 0].tolist() == np.float32([0.1, 0.2, 0.3]).tolist()


NAMES = {
    "falcor": ({"position": "posW", "normal": "normW", "motion": "mvec"}, [1, 1, 1], 1),
    "godot": ({"position": "Position", "combined": "Color", "motion": "Motion"}, [1, 1, 1], 1),
    "unity": ({"position": "Position", "normal": "Normals", "combined": "Beauty", "motion": "MotionVectors"},
              [-1, 1, 1], -1),
    "unity, multi-part": ({"position": "Position", "motion": "Motion Vectors"}, [-1, 1, 1], -1),
}  # fmt: skip
"""Program -> names of its files, its axes in those of glTF, and the sign of its motion, fractions of the image."""


@pytest.mark.parametrize("program", NAMES)
def test_files_of_game_engines(tmp_path, program):
    """One layer per texture; Unity is left-handed and has the motion to the current frame."""
    _, expected = blender_frame()
    names, axes, sign = NAMES[program]
    stored = {"position": expected["position"] * axes, "normal": expected["normal"] * axes,
              "combined": expected["direct"], "motion": sign * expected["motion"] / [WIDTH, HEIGHT]}  # fmt: skip
    shaped = {}
    for name, file_name in names.items():
        shaped |= planes(stored[name], file_name, "RG" if name == "motion" else "RGB")
    frame, _ = frame_of(tmp_path, shaped, mapping=load_mapping(program.partition(",")[0]))
    for name in names:
        truth = expected["direct" if name == "combined" else name]
        np.testing.assert_allclose(getattr(frame, name), truth, rtol=1e-5)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"up": "y"}, "passes"),
        ([], "the file"),
        ({"passes": {"hue": "x"}}, "hue"),
        ({"passes": {"position": {"channels": ["x"]}}}, "position"),
        ({"passes": {"position": 3}}, "passes.position"),
        ({"up": "x", "passes": {}}, "up"),
        ({"motion": {"unit": "m"}, "passes": {}}, "motion.unit"),
        ({"rows": "down", "passes": {}}, "rows"),
        ({"background_depth": True, "passes": {}}, "background_depth"),
        ({"meters": 0, "passes": {}}, "meters"),
        ({"motion": {"zero": "1"}, "passes": {}}, "motion.zero"),
    ],
)
def test_faulty_mappings_name_the_key(tmp_path, values, key):
    path = tmp_path / "m.json"
    path.write_text(json.dumps(values))
    with pytest.raises(PathTracedError) as error:
        load_mapping(path)
    assert error.value.where == str(path) and key in error.value.what and "\n" not in str(error.value)


def test_an_unknown_preset_is_refused(tmp_path):
    with pytest.raises(PathTracedError) as error:
        load_mapping("blendr")
    assert error.value.where == "blendr" and all(name in error.value.hint for name in presets())
