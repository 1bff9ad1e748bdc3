"""Inputs of methods: every input against its channel, jitter and fill against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from references.shading_rate import nearest_shaded, shaded
from repeated import few
from reuse_scenes import SIZE, passing_box, settings, sliding, still
from reuse_tools import arrays, evaluate, open_inputs

from taubench_gl.animation import choose_camera
from taubench_gl.animation.jitter import grid_offsets, halton_jitter
from taubench_gl.animation.pairs import sky_directions
from taubench_gl.conventions import NO_HISTORY, Reason
from taubench_gl.errors import PathTracedError, SettingsError
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.math3d import normalize
from taubench_gl.metrics.environment import directions, lookup
from taubench_gl.metrics.shading_rate import RATES, cycle
from taubench_gl.pathtraced.exr import write_exr
from taubench_gl.reuse.file_inputs import FileInputs
from taubench_gl.reuse.frame import FAR_AWAY_PX, INPUTS
from taubench_gl.reuse.input_kind import InputKind, parse_input
from taubench_gl.reuse.inputs import FrameRequest, light_settings
from taubench_gl.reuse.references import FileReference, SupersampledReference
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box, turn_y
from taubench_gl.selftest.scenes import busy_room, sky_file

ALL = tuple(INPUTS)
MASKS = ("mask", "exact_mask", "motion")


def inputs_of(gpu, scene, kind="full", reads=ALL, **options):
    return open_inputs(gpu, scene, kind, reads, **options)


# --------------------------------------------------------------------------------------------------------------- kinds
@pytest.mark.parametrize(
    "text",
    [
        "full",
        "noisy+quarter+jittered",
        "exr:some/folder",
        "path-traced@16+jittered",
        "path-traced@1+all-lights+jittered",
        "path-traced@1+jittered+upscale@1.5",
    ],
)
def test_input_kind_round_trip(text):
    assert parse_input(text).text == text
    assert parse_input(text).exact == (text == "full")


@pytest.mark.parametrize(
    "text",
    [
        "sharp",
        "",
        "full+noisy",
        "noisy+noisy",
        "half+quarter",
        "exr:folder+noisy",
        "path-traced@0",
        "path-traced@x",
        "path-traced@1+noisy",
        "noisy+all-lights",
        "path-traced@1+half",
        "path-traced@1+path-traced@2",
        "upscale",
        "upscale@x",
        "upscale@1",
        "upscale@5",
        "upscale@2+upscale@3",
        "exr:folder+upscale@2",
    ],
)
def test_invalid_input_kind(text):
    with pytest.raises(SettingsError) as caught:
        parse_input(text)
    assert repr(text) in caught.value.what


def test_path_traced_input_kind():
    kind = parse_input("path-traced", seed=5)
    assert (kind.path_samples, kind.seed, kind.text) == (1, 5, "path-traced@1")
    chosen = light_settings(settings(), parse_input("path-traced@3", seed=5)).lighting
    assert (chosen.light, chosen.spp, chosen.pattern, chosen.seed) == ("path-traced", 3, "independent", 5)
    assert light_settings(settings(light="auto"), parse_input("noisy")).lighting.light == "raster"
    with pytest.raises(SettingsError):
        light_settings(fixed_settings(light="path-traced"), parse_input("noisy"))


@pytest.mark.parametrize("numbers", [{"light_samples": 0}, {"indirect_samples": 5000}, {"seed": -1}, {"seed": 65536}])
def test_invalid_sample_counts_and_seeds(numbers):
    with pytest.raises(SettingsError):
        parse_input("noisy", **numbers)


# -------------------------------------------------------------------------------------------------------------- inputs
def test_inputs_equal_their_channels(gpu):
    scene = sliding()
    with inputs_of(gpu, scene) as inputs:
        inputs.advance(4)
        before = arrays_of_source(inputs.source)
        frame = inputs.advance(5)
        got, now = arrays(frame), arrays_of_source(inputs.source)
    assert set(got) == set(INPUTS) - {"reference"} - set(frame.missing)  # the evaluation adds it
    for name in ("position", "normal", "prev_position", "base_color", "emission", "ids"):
        np.testing.assert_array_equal(got[name], now[name])
    for name in ("position", "normal", "ids"):
        np.testing.assert_array_equal(got[f"history_{name}"], before[name])
    assert (got["radiance"][..., 3] == 1).all()
    surface = now["position"][..., 3] > 0
    np.testing.assert_array_equal(got["radiance"][surface, :3], now["emission"][surface, :3])
    assert frame.index == 1 and frame.time == pytest.approx(5 / 24) and not frame.cut
    assert frame.pair.camera_delta == pytest.approx([-0.25, 0, 0])


def arrays_of_source(source) -> dict[str, np.ndarray]:
    return {name: source.read(name).copy() for name in source.channels}


def test_only_channels_that_are_read_are_rendered(gpu):
    with inputs_of(gpu, still(), reads=("radiance", "position")) as inputs:
        frame = inputs.advance(0)
        assert inputs.exact is None and not {"ids", "prev_position"} & set(inputs.source.channels)
        assert set(frame.textures) == {"radiance", "position"}
        lean = inputs.bytes
    with inputs_of(gpu, still()) as inputs:
        assert inputs.bytes > lean


@pytest.mark.parametrize("kind", ["full", "checkerboard", "path-traced@1"])
def test_direct_is_the_direct_part_of_radiance(gpu, kind):
    """Exposed light of one bounce; the rest is that of more; the sky is in both; unshaded pixels are filled alike."""
    lit = {"exposure": 2.0, "environment": (0.1, 0.2, 0.3), "indirect": "auto"}
    with inputs_of(gpu, still(), kind, reads=("radiance", "direct", "position"), settings=lit) as inputs:
        inputs.advance(0)
        got = arrays(inputs.advance(1))
        at = nearest_shaded("checkerboard" if kind == "checkerboard" else "full", SIZE, 1)
        once, more = (2.0 * inputs.source.read(n)[at[..., 1], at[..., 0], :3] for n in ("direct", "indirect"))
    surface = got["position"][at[..., 1], at[..., 0], 3] > 0
    assert more[surface].max() > 0.01 and not surface.all()
    np.testing.assert_array_equal(got["direct"][~surface], got["radiance"][~surface])
    assert (got["radiance"][~surface, :3] == np.float32([0.2, 0.4, 0.6])).all()
    np.testing.assert_array_equal(got["direct"][surface, :3], once[surface])
    np.testing.assert_array_equal(got["direct"][..., 3], got["radiance"][..., 3])
    rest = (got["radiance"] - got["direct"])[surface, :3]
    np.testing.assert_allclose(rest, more[surface], atol=2e-6)


@pytest.mark.parametrize("kind", ["noisy", "jittered+noisy"])
def test_emission_is_part_of_noisy_radiance(gpu, kind):
    """In a scene with emission only, radiance is the emission of the samples, without noise."""
    with inputs_of(gpu, passing_box(), kind, reads=("radiance", "position", "emission")) as inputs:
        got = arrays(inputs.advance(12))
    surface = got["position"][..., 3] > 0
    assert got["emission"][surface].max() > 0.5
    np.testing.assert_array_equal(got["radiance"][surface, :3], got["emission"][surface, :3])


@pytest.mark.parametrize("rate", RATES[1:])
def test_unshaded_pixels_are_filled(gpu, rate):
    reads = ("radiance",)
    with inputs_of(gpu, still(), reads=reads) as whole, inputs_of(gpu, still(), rate, reads) as part:
        for frame in range(4):
            full = arrays(whole.advance(frame))["radiance"][..., :3]
            got = arrays(part.advance(frame))["radiance"]
            done, at = shaded(rate, SIZE, frame), nearest_shaded(rate, SIZE, frame)
            np.testing.assert_array_equal(got[..., 3] == 1, done)
            np.testing.assert_array_equal(got[..., :3], full[at[..., 1], at[..., 0]])


@pytest.mark.parametrize(("kind", "size", "period"), [("jittered", SIZE, 16), ("jittered+upscale@2", (32, 24), 32)])
def test_positions_of_jittered_samples(gpu, kind, size, period):
    with inputs_of(gpu, still(), kind, reads=("position",)) as inputs:
        for number in (0, 1, 18):
            frame = inputs.advance(number)
            np.testing.assert_array_equal(frame.jitter_px, halton_jitter(number, period))
            position = arrays(frame)["position"].astype(np.float64)
            clip = np.concatenate([position[..., :3], np.ones_like(position[..., :1])], axis=-1)
            clip = clip @ frame.view.centered().clip_from_relative(*size).T
            at = (clip[..., :2] / np.where(clip[..., 3:] > 0, clip[..., 3:], 1.0) + 1.0) * 0.5 * size - 0.5
            x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1] - 1, -1, -1))
            surface = position[..., 3] > 0
            off = at - np.stack([x, y], axis=-1) - frame.jitter_px
            assert np.abs(off[surface]).max() < 1e-3


@pytest.mark.parametrize("rate", RATES)
def test_every_pixel_gets_every_jitter_offset(gpu, rate):
    """The periods of shading rates and of Halton's base 2 have a common factor."""
    frames, kind = range(16 * cycle(rate)), "jittered" if rate == "full" else f"{rate}+jittered"
    with inputs_of(gpu, still(), kind, reads=("radiance",), settings={"width": 8, "height": 6}) as inputs:
        offsets = [inputs.advance(frame).jitter_px for frame in frames]
    for x, y in ((0, 0), (1, 0), (0, 1), (1, 1)):
        got = [tuple(at) for frame, at in zip(frames, offsets) if shaded(rate, (8, 6), frame)[y, x]]
        assert sorted(got) == sorted(tuple(halton_jitter(n)) for n in range(16))


@pytest.mark.parametrize("kind", ["full", "jittered", "noisy+jittered"])
def test_still_scene_has_zero_motion(gpu, kind):
    with inputs_of(gpu, still(), kind, reads=MASKS) as inputs:
        first = arrays(inputs.advance(0))
        assert (first["mask"] & np.uint32(Reason.FIRST)).all() and (first["exact_mask"] & np.uint32(Reason.FIRST)).all()
        for number in range(1, 4):
            got = arrays(inputs.advance(number))
            assert not got["motion"].any()
            assert not (got["mask"] & np.uint32(Reason.OUTSIDE | Reason.BEHIND)).any()
            assert not (got["exact_mask"] & ~np.uint32(Reason.SKY | Reason.HISTORY_SKY)).any()


def test_mask_has_geometry_bits_and_exact_mask_also_light_bits(gpu):
    with inputs_of(gpu, passing_box(), "noisy", reads=MASKS) as inputs:
        for number in range(11, 14):
            got = arrays(inputs.advance(number))
    light = np.uint32(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR | Reason.LIT | Reason.SHADOWED)
    assert not (got["mask"] & light).any()
    assert (got["mask"] & np.uint32(Reason.DISOCCLUDED)).any() and (got["exact_mask"] & np.uint32(Reason.COLOR)).any()
    np.testing.assert_array_equal(got["mask"], got["exact_mask"] & ~light)


def test_motion_of_points_behind_the_previous_camera(gpu):
    with inputs_of(gpu, turned_round(), reads=MASKS, settings={"fps": 1.0}) as inputs:
        inputs.advance(0)
        got = arrays(inputs.advance(1))
    behind = (got["mask"] & np.uint32(Reason.BEHIND)) != 0
    assert behind[..., 0].mean() > 0.9 and (np.abs(got["motion"][behind[..., 0]]) == FAR_AWAY_PX).all()


def turned_round():
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((5.0, 5.0, 5.0), inside=True)))
    b.light(intensity=5.0)
    camera = b.camera(yfov=np.radians(50.0), znear=0.1)
    b.animate(camera, "rotation", [0.0, 0.5, 1.0], [turn_y(0.0), turn_y(90.0), turn_y(180.0)])
    return b.build()


def test_declared_cut_sets_the_masks(gpu):
    with inputs_of(gpu, still(), reads=MASKS, cuts=(2,)) as inputs:
        for number in range(4):
            frame = inputs.advance(number)
            got = arrays(frame)
            assert frame.cut == (number == 2)
            assert ((got["mask"] & np.uint32(Reason.CUT)) != 0).all() == (number == 2)


def test_noise_depends_on_frame_and_seed(gpu):
    with inputs_of(gpu, still(), "noisy", reads=("radiance",)) as inputs:
        a, b = (arrays(inputs.advance(n))["radiance"] for n in range(2))
    with inputs_of(gpu, still(), "noisy", reads=("radiance",)) as inputs:
        again = arrays(inputs.advance(0))["radiance"]
    np.testing.assert_array_equal(a, again)
    assert np.mean(np.any(a != b, axis=-1)) > 0.3


def test_image_too_small_for_the_shading_rate(gpu):
    with pytest.raises(SettingsError), inputs_of(gpu, still(), "half", settings={"height": 1}):
        pass


# ----------------------------------------------------------------------------------------------------------- reference
def test_reference_is_the_mean_of_its_samples(gpu):
    scene, kind, chosen = sliding(), InputKind(), settings()
    reference = SupersampledReference(FrameRequest(gpu, scene, choose_camera(scene), chosen, kind), 4)
    images = []
    for offset in grid_offsets(4):
        with inputs_of(gpu, scene, "jittered", reads=("radiance",), jitter=lambda _, o=offset: o) as inputs:
            images.append(arrays(inputs.advance(3))["radiance"][..., :3])
    got = reference.image(3).radiance
    np.testing.assert_allclose(got, np.mean(images, axis=0), atol=1e-6)
    assert np.abs(images[0] - images[3]).max() > 0.05
    np.testing.assert_array_equal(reference.image(3).radiance, got)
    reference.release()


# --------------------------------------------------------------------------------------------------------------- files
@pytest.fixture(scope="module")
def exr_folder(session_gpu, tmp_path_factory):
    """Four frames of a sliding camera as Blender would write them: Combined, Position, Normal, Depth."""
    folder = tmp_path_factory.mktemp("exr")
    scene = sliding()
    with session_gpu as gpu:
        source = RasterSource(gpu, AnimatedScene(scene), settings(columns=("position", "normal", "color")))
        for number in range(4):
            view = source.advance(number)
            p, n, light = (source.read(c).astype(np.float32) for c in ("position", "normal", "emission"))
            sky = p[..., 3:] == 0
            world = np.where(sky, 0, p[..., :3] + view.position)
            channels = {}
            for name, values, letters in (
                ("Position", np.stack([world[..., 0], -world[..., 2], world[..., 1]], -1), "XYZ"),
                ("Normal", np.stack([n[..., 0], -n[..., 2], n[..., 1]], -1), "XYZ"),
                ("Depth", np.where(sky, 1e10, p[..., 3:]), "Z"),
                ("Combined", light[..., :3], "RGB"),
            ):
                for k, letter in enumerate(letters):
                    channels[f"ViewLayer.{name}.{letter}"] = values[..., k].astype(np.float32)
            write_exr(folder / f"frame_{number:04d}.exr", channels)
        source.release()
    return folder


def test_file_inputs_equal_the_rendered_frames(gpu, exr_folder):
    scene, spec = sliding(), f"exr:{exr_folder}"
    kind = InputKind(files=spec)
    made = settings(exposure=0.5, frames=(1, None))
    request = FrameRequest(gpu, scene, choose_camera(scene), made, kind)
    files = FileInputs(request, ALL, exact=spec)
    missing = ("base_color", "ids", "emission", "prev_position", "history_ids")  # rasterized: not in the files
    reads = ("radiance", "direct", "position", "normal", "motion", "mask", *missing)
    with inputs_of(gpu, scene, reads=reads, settings={"exposure": 0.5}) as rendered:
        assert list(files.frames) == [1, 2, 3]
        for number in range(3):
            frame = files.advance(number)
            got, expected = arrays(frame), arrays(rendered.advance(number))
            for name in reads:
                close = {"atol": 2e-3 if name == "motion" else 2e-5}
                few = 3 if name in ("normal", "prev_position") else None  # the fourth component is unused
                np.testing.assert_allclose(got[name][..., :few], expected[name][..., :few], **close)
    assert "exact_mask" in frame.textures
    assert all(name in files.describe()["notes"][0] for name in ("base_color", "ids", "emission"))
    assert files.describe()["motion_from"] == "rasterized"
    bare = FileInputs(FrameRequest(gpu, None, None, settings(), kind), ALL)
    assert set(missing).isdisjoint(bare.advance(0).textures)
    bare.release()
    reference = FileReference(request, spec, files.size, range(1, 4))
    np.testing.assert_array_equal(reference.image(2).radiance, got["radiance"][..., :3])
    files.release()


@pytest.mark.parametrize(("size", "frames", "value"), [((32, 24), range(2), "64x48"), (SIZE, range(2, 6), "4")])
def test_file_reference_with_wrong_size_or_missing_frames(exr_folder, size, frames, value):
    request = FrameRequest(None, None, None, settings(), parse_input("full"))
    with pytest.raises(PathTracedError) as caught:
        FileReference(request, f"exr:{exr_folder}", size, frames)
    assert caught.value.where == str(exr_folder) and value in caught.value.what


# -------------------------------------------------------------------------------------------------- cuts of a surface
@pytest.mark.parametrize("reprojection", ["camera", "motion"])
def test_surface_with_changed_faces_is_cut_in_both_masks(gpu, tmp_path, reprojection):
    """An OBJ sequence whose left object has other faces from frame 2 on: no history in that frame only."""
    faces = ("f 1 2 3 4\n", "f 1 2 3 4\n", "f 1 2 3 4\nf 4 3 2 1\n", "f 1 2 3 4\nf 4 3 2 1\n")
    right = "o right\nv 0 -1 0\nv 2 -1 0\nv 2 1 0\nv 0 1 0\nf 5 6 7 8\n"
    for i, left in enumerate(faces):
        corners = "".join(f"v {x} {y} 0\n" for x, y in ((-2, -1), (0, -1), (0, 1), (-2, 1)))
        (tmp_path / f"s{i}.obj").write_text(f"o left\n{corners}{left}{right}")
    scene = load_scene(tmp_path)
    with inputs_of(gpu, scene, reads=("mask", "exact_mask", "ids"), settings={"reprojection": reprojection}) as made:
        for frame in range(4):
            found = arrays(made.advance(frame))
            fresh = found["ids"][..., 1] & NO_HISTORY > 0
            assert fresh.any() == (frame == 2)
            for name in ("mask", "exact_mask"):
                cut = found[name][..., 0] & np.uint32(Reason.CUT) > 0
                np.testing.assert_array_equal(cut, fresh, err_msg=f"{name}, frame {frame}")


@pytest.mark.parametrize("columns", [("frustum",), ("frustum", "direct", "color")])
def test_a_reuse_evaluation_meters_whatever_the_columns(columns):
    auto = {"exposure": "auto", "light_unit": "auto", "environment": "auto", "columns": columns}
    done = evaluate(busy_room(lamps=2), ["none"], (0, 3), settings=auto)
    settings = done.summary["settings"]
    assert settings["exposure"] not in (1.0, "auto") and settings["light_unit"] == "candela"
    assert settings["columns"] == list(columns) and "metered" in done.summary["lighting"]["exposure"]


@pytest.mark.parametrize("kind", few(["half+jittered", "full", "noisy"]))
def test_sky_pixels_of_radiance_show_the_environment_image(gpu, tmp_path, kind):
    image = 0.5 + 0.5 * directions(64)
    with sky_file(image) as path:
        changes = {"exposure": 2.0, "environment": path}
        with inputs_of(gpu, still(), kind, reads=("radiance", "position"), settings=changes) as inputs:
            got = arrays(inputs.advance(0))["radiance"]
            view, position = inputs.source.renderer.frame.view, inputs.source.read("position")
    h, w = position.shape[:2]
    origin, dx, dy = sky_directions(view, w, h)
    x, y = np.meshgrid(np.arange(w), np.arange(h)[::-1])
    expected = 2.0 * lookup(image, normalize(origin + x[..., None] * dx + y[..., None] * dy))
    sky = (position[..., 3] == 0) & (got[..., 3] == 1.0)
    assert sky.any()
    np.testing.assert_allclose(got[sky][:, :3], expected[sky], atol=2e-3)
