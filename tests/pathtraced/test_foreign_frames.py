"""Frames of other programs: what a mapping can say, the camera of every frame, vectors of the files, samples."""

from __future__ import annotations

import copy
import itertools
import json

import numpy as np
import pytest
from fixed import fixed_settings
from foreign_frames import HEIGHT, MAPPING, SIZE, WIDTH, channels_of, passes_of, view_at, write_frames

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.errors import PathTracedError
from taubench_gl.evaluation import Observers
from taubench_gl.features import FEATURES
from taubench_gl.metrics.color import PRIMARIES, rec709_from
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.pathtraced.cameras import camera_file_text, points_at, project, residual
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.pathtraced.source import frame_channels
from taubench_gl.scene.model import Camera

MOTION = fixed_settings(reprojection="motion")


def mapping_file(folder, without=(), motion=None, **more):
    """MAPPING with the keys ``more`` and ``motion``, and without the passes ``without``, as a file."""
    values = copy.deepcopy(MAPPING) | more
    values["motion"] |= motion or {}
    values["passes"] = {name: value for name, value in values["passes"].items() if name not in without}
    path = folder / "mapping.json"
    path.write_text(json.dumps(values))
    return path


def read(folder, mapping, frame=1, **chosen):
    return PathTracedSequence.open(folder, mapping=mapping, **chosen).read(frame)


def evaluated(folder, mapping, settings=None, **options):
    options = {"camera_file": folder / "camera.json", "mapping": mapping} | options
    return evaluate_path_traced(f"exr:{folder}", settings, PathTracedOptions(**options))


# ----------------------------------------------------------------------------------------------------------- mapping
def velocity(convert):
    """A change of the stored motion of a frame, (h, w, 2) pixels, +y down."""

    def change(channels, frame):
        stored = convert(np.stack([channels["Velocity.X"], channels["Velocity.Y"]], axis=-1))
        return channels | {f"Velocity.{c}": stored[..., i].astype(np.float32) for i, c in enumerate("XY")}

    return change


@pytest.mark.parametrize(
    ("keys", "convert"),
    [
        ({"unit": "ndc"}, lambda v: 2.0 * v / SIZE),
        ({"unit": "ndc", "direction": "current-previous", "y": "up"}, lambda v: v * [-2.0, 2.0] / SIZE),
        ({"unit": "uv", "zero": "0.5"}, lambda v: 0.5 + v / SIZE),
        ({"unit": "uv", "zero": "0.5", "encoding": "cube-root"}, lambda v: 0.5 + 0.5 * np.cbrt(v / SIZE)),
        ({"unit": "ndc", "encoding": "cube-root"}, lambda v: np.cbrt(2.0 * v / SIZE)),
    ],
)
def test_motion_is_decoded(tmp_path, keys, convert):
    frame = read(write_frames(tmp_path / "f", change=velocity(convert)), mapping_file(tmp_path, motion=keys))
    np.testing.assert_allclose(frame.motion, passes_of(1)["motion"], atol=2e-4)


def test_pixels_with_the_value_of_no_data_have_no_vector(tmp_path):
    def coded(v):
        return np.where(np.all(v == 0, axis=-1, keepdims=True), 0.0, 0.5 + 0.5 * np.cbrt(v / SIZE))

    keys = {"unit": "uv", "zero": "0.5", "encoding": "cube-root", "no_data": 0.0}
    frame = read(write_frames(tmp_path / "f", change=velocity(coded)), mapping_file(tmp_path, motion=keys))
    np.testing.assert_array_equal(np.isnan(frame.motion).any(axis=-1), passes_of(1)["sky"])


def test_files_whose_bottom_row_is_first(tmp_path):
    upside_down = write_frames(tmp_path / "f", change=lambda channels, _: {n: v[::-1] for n, v in channels.items()})
    frame, truth = read(upside_down, mapping_file(tmp_path, rows="bottom")), passes_of(1)
    for name in ("position", "prev_position", "normal", "motion", "combined", "sky", "depth"):
        np.testing.assert_allclose(getattr(frame, name), truth[name], atol=1e-5)


def test_normals_with_the_axes_of_the_view(tmp_path):
    turn = math3d.mat3_from_quat(math3d.quat_from_axis_angle(np.array([0.0, 1.0, 0.0]), 0.3))
    turned = View(view_at(1).position, turn, view_at(1).camera)
    frame = read(write_frames(tmp_path / "f"), mapping_file(tmp_path, normals="view"))
    arrays = frame_channels(frame, turned, turned, fixed_settings())
    np.testing.assert_allclose(arrays["normal"], passes_of(1)["normal"] @ turn.T, atol=1e-6)


@pytest.mark.parametrize("kind", ["planar", "distance", "view-z"])
@pytest.mark.parametrize("offset", [0.0, 0.25])
@pytest.mark.parametrize("camera", ["perspective", "orthographic"])
def test_kinds_of_depth(kind, offset, camera):
    lens = {"yfov": 0.9} if camera == "perspective" else {"kind": camera, "ymag": 2.0, "xmag": 2.0, "zfar": 50.0}
    turned = math3d.mat3_from_quat(math3d.quat_from_axis_angle(np.array([0.0, 1.0, 0.0]), 0.4))
    view = View(np.array([1.0, 2.0, 3.0]), turned, Camera(**lens))
    rng = np.random.default_rng(0)
    local = np.column_stack([rng.uniform(-1, 1, (200, 2)), -rng.uniform(2, 9, 200)])
    points = local @ turned.T
    planar, cosine = -local[:, 2], -local[:, 2] / np.linalg.norm(local, axis=1)
    stored = np.linalg.norm(local, axis=1) - offset / cosine if kind == "distance" else planar - offset
    if kind == "distance" and camera == "orthographic":
        stored = planar - offset  # rays are parallel: a distance along the ray is planar
    found = points_at(view, project(view, points, SIZE, relative=True), stored, kind, SIZE, offset)
    np.testing.assert_allclose(found, points, atol=1e-9)


def test_depth_of_the_wrong_sign_is_refused_and_names_its_kind(tmp_path):
    def negative(channels, frame):
        return channels | {"Depth.Z": -channels["Depth.Z"]}

    folder = write_frames(tmp_path / "f", change=negative)
    whole = evaluated(write_frames(tmp_path / "g"), mapping_file(tmp_path, without=("position", "prev_position")))
    planar = mapping_file(tmp_path, without=("position", "prev_position"))
    with pytest.raises(PathTracedError) as error:
        evaluated(folder, planar)
    assert "view-z" in error.value.hint
    run = evaluated(folder, mapping_file(tmp_path, without=("position", "prev_position"), depth="view-z"))
    assert run.summary["discard"]["position"] == whole.summary["discard"]["position"]
    with pytest.raises(PathTracedError):
        evaluated(tmp_path / "g", mapping_file(tmp_path, depth="view-z"))


@pytest.mark.parametrize("what", ["infinite", "far depth", "no normal"])
def test_sky(tmp_path, what):
    """LuxCore: positions are infinite; EEVEE 4.5: depth is the far plane, position and normal 0."""
    sky = passes_of(1)["sky"]

    def change(channels, frame):
        empty = passes_of(frame)["sky"]
        if what == "infinite":
            return {n: np.where(empty & n.startswith("Pos"), np.inf, v).astype(np.float32) for n, v in channels.items()}
        return channels | {"Depth.Z": np.where(empty, 100.0, channels["Depth.Z"]).astype(np.float32)}

    without = {"infinite": ("depth",), "far depth": (), "no normal": ("position", "prev_position")}[what]
    folder, more = write_frames(tmp_path / "f", change=change), {"sky": "normal"} if what == "no normal" else {}
    np.testing.assert_array_equal(read(folder, mapping_file(tmp_path, without, **more)).sky, sky)
    if what == "no normal":
        notes = evaluated(folder, mapping_file(tmp_path, without)).summary["notes"]
        assert any("sky = 'normal'" in note for note in notes)


def test_primaries():
    """ITU-R BT.2087: linear BT.2020 to BT.709; and white stays white from any white point."""
    expected = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
    np.testing.assert_allclose(rec709_from(PRIMARIES["rec2020"]), expected, atol=1e-4)
    for name, chromaticities in PRIMARIES.items():
        np.testing.assert_allclose(rec709_from(chromaticities) @ np.ones(3), np.ones(3), atol=1e-12, err_msg=name)
    ap1 = [[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]]
    np.testing.assert_allclose(rec709_from(PRIMARIES["ap1"]), ap1, atol=2e-4)  # ACES 1.0, OpenColorIO's config


@pytest.mark.parametrize("stated", ["file", "mapping"])
def test_light_of_other_primaries_is_converted(tmp_path, stated):
    from exr_files import write

    header = {"chromaticities": PRIMARIES["ap1"]} if stated == "file" else {}
    folder = tmp_path / "f"
    folder.mkdir()
    write(folder / "f_001.exr", channels_of(passes_of(1)), **header)
    mapping = mapping_file(tmp_path, **({} if stated == "file" else {"primaries": "ap1"}))
    truth = passes_of(1)["combined"] @ rec709_from(PRIMARIES["ap1"]).T
    np.testing.assert_allclose(read(folder, mapping).combined, truth, atol=1e-6)
    np.testing.assert_allclose(PathTracedSequence.open(folder, mapping=mapping).radiance(1), truth, atol=1e-6)
    if stated == "file":
        as_is = read(folder, mapping_file(tmp_path, primaries="rec709")).combined
        np.testing.assert_allclose(as_is, passes_of(1)["combined"], atol=1e-6)
        with pytest.raises(PathTracedError):
            read(folder, mapping_file(tmp_path, color="encoded"))
        for no_primaries in ((0.3,) * 8, (0.64, 0.33, 0.3, 0.0, 0.15, 0.06, 0.31, 0.33), (float("nan"),) * 8):
            write(folder / "f_001.exr", channels_of(passes_of(1)), chromaticities=no_primaries)
            with pytest.raises(PathTracedError):
                read(folder, mapping)
        write(folder / "f_001.exr", channels_of(passes_of(1)), multiView=3, view=2.0)
        np.testing.assert_allclose(read(folder, mapping).combined, passes_of(1)["combined"], atol=1e-6)


def test_passes_that_a_mapping_omits_are_not_asked_for(tmp_path):
    """Direct light without transmission, and lobes whose light contains their color; indirect is null."""
    light = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    lobes = {f"{name}.{c}": light for name in ("DiffDir", "DiffCol", "GlossDir") for c in "RGB"}
    folder = write_frames(tmp_path / "f", change=lambda channels, _: channels | lobes)
    passes = MAPPING["passes"] | {"diffuse_direct": "DiffDir", "diffuse_color": "DiffCol", "glossy_direct": "GlossDir"}
    mapping = mapping_file(tmp_path, passes=passes)
    sequence = PathTracedSequence.open(folder, mapping=mapping)
    assert set(sequence.missing()) == {"indirect"} and "mapping" in sequence.missing()["indirect"]
    np.testing.assert_array_equal(sequence.read(1).radiance["direct"], 0.75)
    passes["transmission_direct"] = "TransDir"  # named, so that it is asked for
    missing = PathTracedSequence.open(folder, mapping=mapping_file(tmp_path, passes=passes)).missing()
    assert missing["direct"].endswith("TransDir")


def test_a_subsampled_channel_is_named(tmp_path):
    import OpenEXR

    folder = tmp_path / "f"
    folder.mkdir()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = channels_of(passes_of(1))
    channels["Normal.X"] = OpenEXR.Channel("Normal.X", np.zeros((HEIGHT, WIDTH), np.float32), 2, 2)
    OpenEXR.File(header, channels).write(str(folder / "f_001.exr"))
    with pytest.raises(PathTracedError, match=r"Normal\.X is subsampled"):
        read(folder, mapping_file(tmp_path))
    assert read(folder, mapping_file(tmp_path, without=("normal",))).normal is None


@pytest.mark.parametrize("layout", ["one part", "a part each"])
def test_views_of_stereo_files(tmp_path, layout):
    """Blender's two layouts: the view in the channel names, or a part for each pass and view with equal names."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    views = {"left": channels_of(passes_of(1)), "right": channels_of(passes_of(2))}
    named = {f"{v}.{n}": plane for v, channels in views.items() for n, plane in channels.items()}
    folder = tmp_path / "f"
    folder.mkdir()
    if layout == "one part":
        stored = {}
        for name, plane in named.items():
            view, *rest, component = name.split(".")
            stored[".".join([*rest, view, component])] = plane
        OpenEXR.File(header | {"multiView": list(views)}, stored).write(str(folder / "f_001.exr"))
    else:
        passes: dict[str, dict[str, np.ndarray]] = {}
        for name, plane in named.items():
            view, _, channel = name.partition(".")
            passes.setdefault(f"{channel.rpartition('.')[0] or 'Combined'}-{view}", {})[channel] = plane
        parts = [
            OpenEXR.Part(header | {"view": name.rpartition("-")[2]}, group, name) for name, group in passes.items()
        ]
        OpenEXR.File(parts).write(str(folder / "f_001.exr"))
    mapping = mapping_file(tmp_path, without=("combined",))
    for view, frame in (("left", 1), ("right", 2)):
        found = read(folder, mapping, view=view)
        np.testing.assert_allclose(found.position, passes_of(frame)["position"], atol=1e-5)
    first = PathTracedSequence.open(folder, mapping=mapping)
    assert first.index.view == "left" and "right" in first.index.notes[0]
    assert PathTracedSequence.open(folder, mapping=mapping, view="left").index.notes == []
    with pytest.raises(PathTracedError, match="middle"):
        PathTracedSequence.open(folder, mapping=mapping, view="middle")


# ------------------------------------------------------------------------------------------- the camera of every frame
def test_a_pose_that_is_not_that_of_its_frame_is_refused_with_the_frame(tmp_path):
    folder, mapping = write_frames(tmp_path / "f"), mapping_file(tmp_path)
    assert evaluated(folder, mapping).summary["path_traced"]["camera_mismatch_px"] < 1e-4
    for poses, frame in (({1: 1, 2: 1, 3: 2}, 2), ({1: 1, 2: 2, 3: 1}, 3), ({1: 2, 2: 3, 3: 1}, 1)):
        views = {number: view_at(shown) for number, shown in poses.items()}
        (folder / "camera.json").write_text(camera_file_text(views, 24.0, SIZE))
        with pytest.raises(PathTracedError, match=f"frame {frame}") as error:
            evaluated(folder, mapping)
        right = next((number for number, shown in poses.items() if shown == frame), None)  # that has its pose
        assert (f"the pose of frame {right} fits" in error.value.hint) == (right is not None)


def test_an_image_that_is_shifted_by_whole_pixels(tmp_path):
    """Residual and evaluation agree; with the principal point set, the image has the masks of the one that is not."""
    folder = write_frames(tmp_path / "f", shift_px=(0.0, -1.0))
    mapping = mapping_file(tmp_path)
    frame = read(folder, mapping)
    found = residual(view_at(1), frame)
    assert not found.fits and found.whole_px == (0, 1) and found.spread_px < 1e-5
    with pytest.raises(PathTracedError) as error:
        evaluated(folder, mapping)
    assert "principal_point = [0, 1]" in error.value.hint
    moved = mapping_file(tmp_path, principal_point=[0, 1])
    run = evaluated(folder, moved)
    assert run.summary["path_traced"]["camera_mismatch_px"] < 1e-4
    by_depth = evaluated(folder, mapping_file(tmp_path, ("position", "prev_position"), principal_point=[0, 1]))
    assert by_depth.summary["discard"]["position"] == run.summary["discard"]["position"]
    sequence = PathTracedSequence.open(folder, mapping=moved)
    passes = sequence.read(2)
    arrays = frame_channels(passes, view_at(2), view_at(1), MOTION)
    arrays["position"][passes.sky] = 0
    assert not np.isnan(arrays["position"]).any()


def test_frames_without_a_surface_prove_nothing(tmp_path):
    """An empty first file: the camera of the others is checked all the same, and nothing of it has motion."""

    def empty(channels, frame):
        return {n: np.where(n[0] == "V", np.nan, 0.0).astype(np.float32) + 0 * v for n, v in channels.items()}

    folder = write_frames(tmp_path / "f", change=lambda channels, n: empty(channels, n) if n == 1 else channels)
    run = evaluated(folder, mapping_file(tmp_path))
    assert run.summary["path_traced"]["camera_mismatch_px"] < 1e-4
    (folder / "camera.json").write_text(camera_file_text({n: view_at(n + 1) for n in (1, 2, 3)}, 24.0, SIZE))
    with pytest.raises(PathTracedError, match="frame 2"):
        evaluated(folder, mapping_file(tmp_path))
    everywhere = write_frames(tmp_path / "g", change=empty)
    assert evaluated(everywhere, mapping_file(tmp_path)).summary["path_traced"]["camera_mismatch_px"] is None


def test_a_rate_that_does_not_fit_is_refused_with_the_one_that_does(data):
    folder = data / "reports4" / "frames" / "8_wrong_fps"
    options = PathTracedOptions(scene_file=folder / "scene.glb")
    right = evaluate_path_traced(f"exr:{folder}", fixed_settings(fps=24), options).summary["discard"]
    assert right["position"]["mean_percent"] == pytest.approx(7.86, abs=0.01)
    with pytest.raises(PathTracedError, match="frame 1") as error:
        evaluate_path_traced(f"exr:{folder}", fixed_settings(fps=30), options)
    assert "--fps 24 fits" in error.value.hint


# ------------------------------------------------------------------------------------------------- vectors of the files
def masks_of(folder, mapping, settings):
    masks, motion = {}, {}

    def keep(pair):
        masks[pair.frame], motion[pair.frame] = pair.mask, pair.motion

    options = PathTracedOptions(camera_file=folder / "camera.json", mapping=mapping)
    run = evaluate_path_traced(f"exr:{folder}", settings, options, Observers(on_pair=keep))
    return run, masks, motion


@pytest.mark.parametrize("sampling", ["nearest", "bilinear"])
@pytest.mark.parametrize("without", [(), ("prev_position",), ("position", "prev_position")])
def test_history_is_sampled_where_the_vectors_of_the_files_point(tmp_path, sampling, without):
    """Random vectors, some without a value: the masks are those of the float64 reference with these vectors."""
    rng = np.random.default_rng(3)

    def noise(v):
        v = v + rng.normal(0.0, 3.0, v.shape)
        v[rng.random(v.shape[:2]) < 0.05] = np.nan
        return v

    folder, mapping = write_frames(tmp_path / "f", change=velocity(noise)), mapping_file(tmp_path, without)
    settings = fixed_settings(reprojection="motion", sampling=sampling)
    _, masks, motion = masks_of(folder, mapping, settings)
    sequence, limits = (
        PathTracedSequence.open(folder, mapping=mapping),
        {f: settings.metrics.threshold(f) for f in FEATURES},
    )
    for frame in (2, 3):
        now, before = (
            frame_channels(sequence.read(n), view_at(n), view_at(n - 1), settings) for n in (frame, frame - 1)
        )
        pair = reprojection(view_at(frame), view_at(frame - 1), *SIZE)
        expected = pair_masks(now, before, pair, limits, sampling=sampling, reprojection="motion")
        np.testing.assert_array_equal(masks[frame], expected.mask)
        stored = np.isfinite(now["vectors"]).all(axis=-1)
        np.testing.assert_allclose(motion[frame][stored], now["vectors"][stored], atol=1e-4)


def test_vectors_decide_what_can_be_reused(tmp_path):
    """Right vectors, and right ones with the wrong sign; camera reprojection beside them."""
    mapping, percent = mapping_file(tmp_path, ("prev_position",)), {}
    for name, convert in (("right", np.positive), ("wrong", np.negative)):
        folder = write_frames(tmp_path / name, change=velocity(convert))
        block = evaluated(folder, mapping, MOTION).summary["reusable"]
        percent[name] = [block[mode]["surface"]["mean_percent"] for mode in ("camera", "motion")]
    assert percent["right"][0] == percent["wrong"][0]
    assert percent["right"][1] > percent["right"][0] + 3 > percent["wrong"][1] + 3


def test_vectors_without_geometry_measure_what_they_can(tmp_path):
    folder, everything = write_frames(tmp_path / "f"), mapping_file(tmp_path)
    whole = evaluated(folder, everything, MOTION).summary["discard"]
    alone = mapping_file(tmp_path, ("position", "prev_position", "depth"), sky="normal")
    run = evaluated(folder, alone, MOTION, camera_file=None)
    for column in ("frustum", "normal", "color"):
        assert run.summary["discard"][column]["mean_percent"] == whole[column]["mean_percent"]
    position = run.summary["discard"]["position"]
    assert position["mean_percent"] is None and "depth" in position["reason"]
    assert run.summary["camera"]["position"]["mean"] is None and run.frames[0]["translation_m"] is None
    assert run.summary["scale"]["median_depth_m"] is None and run.tables()
    with pytest.raises(PathTracedError):  # camera reprojection needs geometry
        evaluated(folder, alone)


# -------------------------------------------------------------------------------------------- samples beside the center
def averaged(samples):
    """A change that replaces every pass by the mean over ``samples`` offsets within the pixel."""

    def change(channels, frame):
        at = (np.arange(samples) + 0.5) / samples - 0.5
        parts = [channels_of(passes_of(frame, (x, y))) for x in at for y in at]
        return {name: np.mean([part[name] for part in parts], axis=0).astype(np.float32) for name in channels}

    return change


def notes(folder, mapping):
    return " ".join(evaluated(folder, mapping).summary["notes"])


def test_filtered_and_jittered_positions_have_a_note(tmp_path):
    mapping = mapping_file(tmp_path)
    assert notes(write_frames(tmp_path / "exact"), mapping) == ""
    filtered = write_frames(tmp_path / "filtered", change=averaged(4))
    assert "on no surface" in notes(filtered, mapping) and "shorter" in notes(filtered, mapping)
    assert "+0.20, -0.30 px" in notes(write_frames(tmp_path / "off", shift_px=(0.2, -0.3)), mapping)
    rng = np.random.default_rng(0)

    def jittered(channels, frame):
        choice = rng.integers(0, 9, (HEIGHT, WIDTH))
        parts = [channels_of(passes_of(frame, at)) for at in itertools.product((-0.3, 0.0, 0.3), repeat=2)]
        return {name: np.choose(choice, [part[name] for part in parts]) for name in channels}

    assert "0.30 px (median)" in notes(write_frames(tmp_path / "jittered", change=jittered), mapping)


def test_half_float_positions_far_from_the_origin_give_way_to_depth(tmp_path):
    """At 100 m they are rounded by centimeters; a camera cannot be estimated from them."""
    far = np.array([100.0, 90.0, 110.0])

    def moved(channels, frame):
        surface = ~passes_of(frame)["sky"]
        halves = {n: (v + far["XYZ".index(n[-1])] * surface).astype(np.float16).astype(np.float32)
                  for n, v in channels.items() if n.startswith("Pos")}  # fmt: skip
        return channels | halves

    folder, mapping = write_frames(tmp_path / "f", change=moved), mapping_file(tmp_path, ("prev_position",))
    views = {n: View(view_at(n).position + far, np.eye(3), view_at(n).camera) for n in (1, 2, 3)}
    (folder / "camera.json").write_text(camera_file_text(views, 24.0, SIZE))
    run = evaluated(folder, mapping)
    near = evaluated(write_frames(tmp_path / "near"), mapping)
    assert run.summary["discard"]["position"] == near.summary["discard"]["position"]
    assert "half floats" in run.summary["notes"][0] and run.summary["path_traced"]["camera_mismatch_px"] > 0.1
    with pytest.raises(PathTracedError, match="half floats"):
        evaluated(folder, mapping, camera_file=None)
    with pytest.raises(PathTracedError, match="depth is"):  # depth of another kind does not replace positions
        evaluated(folder, mapping_file(tmp_path, ("prev_position",), depth_offset=0.5))
    mapping = mapping_file(tmp_path, ("prev_position",))
    (folder / "camera.json").write_text(camera_file_text({n: view_at(n) for n in (1, 2, 3)}, 24.0, SIZE))
    with pytest.raises(PathTracedError, match="frame 1"):
        evaluated(folder, mapping)


REPORTS = {
    "frames2/1_eevee45_sky": ({"mapping": "eevee"}, {"frustum": 2.82, "position": 36.58}, "half floats"),
    "frames2/2_eevee_half_positions": ({"mapping": "eevee"}, {"frustum": 2.82, "position": 36.81}, "half floats"),
    "frames2/3_check_right_files_blamed": ({}, {}, "-0.03, -0.24 px"),
    "frames2/5_lux_row": ({"mapping": "luxcore"}, {"frustum": 1.79, "position": 3.14}, ""),
    "frames2/6_lux_infinite_positions": ({"mapping": "luxcore", "camera_file": None},
                                         {"frustum": 1.79, "position": 3.14}, "estimated"),
    "frames/5_filtered": ({"mapping": "mitsuba"}, {"position": 17.9}, "on no surface"),
    "frames/5_truth": ({"mapping": "mitsuba"}, {"position": 7.5}, ""),
    "exr/two_layers": ({"camera_file": "exr/two_layers.json"}, {}, "Background, Foreground"),
    "exr/aa_1": ({"camera_file": "exr/aa_1.json"}, {"position": 20.4}, ""),
    "exr/aa_8": ({"camera_file": "exr/aa_8.json"}, {"position": 33.4}, "on no surface"),
}  # fmt: skip
"""Folder of frames of real programs -> options, columns in percent, and part of a note; "": no note."""


@pytest.mark.parametrize("name", REPORTS)
def test_frames_of_real_programs(data, name):
    reports = data / "reports4"
    options, columns, note = REPORTS[name]
    camera = options.get("camera_file", f"{name}/camera.json")
    chosen = options | {"camera_file": None if camera is None else reports / camera}
    summary = evaluate_path_traced(f"exr:{reports / name}", None, PathTracedOptions(**chosen)).summary
    for column, percent in columns.items():
        assert summary["discard"][column]["mean_percent"] == pytest.approx(percent, abs=0.05)
    assert note in " ".join(summary["notes"]) and (note or not summary["notes"])


def test_one_verdict_on_the_row_of_luxcore(data):
    """Without its preset: refused by the offset that the residual finds, with the principal point to set."""
    folder = data / "reports4" / "frames2"
    options = {"camera_file": folder / "5_lux_row" / "camera.json", "mapping": folder / "luxcore.toml"}
    with pytest.raises(PathTracedError) as error:
        evaluate_path_traced(f"exr:{folder / '5_lux_row'}", None, PathTracedOptions(**options))
    assert "principal_point = [0, 1]" in error.value.hint
