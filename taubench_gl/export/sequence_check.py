"""Contents of an export of format nss or noisebase, and whether its motion, cameras, depth and light agree.

A convention is checked against named mistakes: each is undone on the same pixels, and where that explains the images or
the geometry better than the file as it is stored, the file is wrong and the mistake has a name.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from taubench_gl.data_files import ARRAY_FAULTS, opened, parse_json, read_json
from taubench_gl.errors import OutputError
from taubench_gl.export.formats import zarr_module
from taubench_gl.export.run import FORMATS, MANIFEST, Manifest
from taubench_gl.export.sequences import TYPES
from taubench_gl.reuse.quality import display, psnr

Array = np.ndarray
Arrays = Mapping[str, Any]
"""Name -> values of a sequence, of which ``values[n]`` is the frame n: (components, h, w) of images."""

Errors = dict[str, dict[str, Array]]
"""Check -> mistake, "" for the file as stored -> errors (h, w) without it, >= 0, NaN: unknown."""

CLEARER = 0.9
"""Part of a sum of errors below which another sum is clearly smaller."""

OTHER_PIXEL_PX = 0.5
"""Points whose mean distance from the centers of their pixels is larger are those of others, jitter included."""

BRIGHTNESS = 1.5
"""Factor between the means of noisy and clean light that is no fault: a few samples per pixel are noisy."""

VECTORS: dict[str, Callable[[Array], Array]] = {
    "": lambda v: v,
    "sign turned": lambda v: -v,
    "x and y swapped": lambda v: v[..., ::-1],
    "x and y swapped and sign turned": lambda v: -v[..., ::-1],
}
"""Mistakes of a vector (..., 2) -> the vector without the mistake."""


def inspect_export(folder: Path) -> dict[str, dict[str, Any]]:
    """Contents and checks of an export as JSON values.  Raises OutputError for files that cannot be read.

    ``checks``: check -> right | wrong | not clear, and why; ``psnr_db``: of a clean frame against the frame before it,
    and against that moved by the motion, where it is inside; None: there is no pair, or they are equal.
    """
    about = read_json(folder / MANIFEST, Manifest)
    name = about["format"]
    if name not in _READERS or not (files := FORMATS[name](folder, None).files()):
        raise OutputError(f"is no finished export of format nss or noisebase, but of {name}", where=str(folder))
    read, compare = _READERS[name]
    checks, shapes, squares, sums = {}, {}, [[0.0, 0.0]], defaultdict(lambda: np.zeros(2))
    for file in files:
        try:
            arrays = read(file)
            shapes |= {key: f"{v.dtype} {'x'.join(map(str, v.shape))}" for key, v in arrays.items()}
            bad = [key for key, v in arrays.items() if not all(np.isfinite(v[n]).all() for n in range(v.shape[0]))]
            checks |= dict.fromkeys(bad, f"wrong: {file.name} has values that are not finite")
            for n in range(1, arrays["motion"].shape[0]):
                if "camera_cut" not in arrays or not arrays["camera_cut"][n].any():
                    with np.errstate(divide="ignore", invalid="ignore"):
                        pair, errors = compare(arrays, n)
                    squares.append(pair)
                    _add(sums, errors)
        except (*ARRAY_FAULTS, IndexError) as error:
            raise OutputError(f"is damaged: {error!s:.200}", where=str(file), hint="export it again") from None
    before, moved = map(psnr, np.sum(squares, axis=0) / max(len(squares) - 1, 1))
    return {
        "export": {"format": name, "files": [file.name for file in files], "exposure": about["settings"]["exposure"]},
        "arrays": shapes,
        "psnr_db": {"frame_before": before, "frame_before_moved": moved},
        "checks": _answers(sums) | checks,
    }


def _add(sums: dict[tuple[str, str], Array], errors: Errors) -> None:
    """Add the errors over the pixels in which a mistake makes a difference."""
    for check, by_mistake in errors.items():
        for mistake in by_mistake.keys() - {""}:
            pair = np.array([by_mistake[""], by_mistake[mistake]])
            sums[check, mistake] += pair[:, np.abs(pair[0] - pair[1]) > 1e-4].sum(axis=1)  # NaN is left out


def _answers(sums: Mapping[tuple[str, str], Array]) -> dict[str, str]:
    out = {}
    for check in dict.fromkeys(name for name, _ in sums):
        ratios = {mistake: (b + 1e-9) / (a + 1e-9) for (name, mistake), (a, b) in sorted(sums.items()) if name == check}
        least, excluded = min(ratios, key=ratios.get), [mistake for mistake in ratios if ratios[mistake] > 1 / CLEARER]
        answer = f"right, excluded: {'; '.join(excluded)}" if excluded else "not clear in these frames"
        out[check] = f"wrong: {least}" if ratios[least] < CLEARER else answer
    return out


# ---------------------------------------------------------------------------------------------------------- one frame
def _compare_nss(arrays: Arrays, number: int) -> tuple[list[float], Errors]:
    """Compare a frame with the one before.  -> mean squared errors of the frame before, unmoved and moved; errors."""
    noisy, clean = (_last(arrays[name][number]) for name in ("colour_linear", "ground_truth_linear"))
    motion, motion_lr = (-_last(arrays[name][number])[..., ::-1] for name in ("motion", "motion_lr"))
    motions = {name: undo(motion) for name, undo in VECTORS.items()}
    images, squares = _compare_images(clean, _last(arrays["ground_truth_linear"][number - 1]), motions)
    grid, size, jitter = _grid(noisy), np.array(noisy.shape[1::-1]), np.float64(arrays["jitter"][number])[::-1]
    shown, truth, scale = _shown(noisy), _shown(clean), clean.shape[1::-1] / size
    at = {name: (grid + undo(jitter) + 0.5) * scale - 0.5 for name, undo in VECTORS.items()}
    light = {name: np.abs(shown - _sample(truth, place)) for name, place in at.items()}
    # Most pixels show still surfaces, whose motion follows from depth and cameras.
    device, cameras = _last(arrays["depth"][number]), [np.float64(arrays["viewProj"][n]) for n in (number, number - 1)]
    ndc, again = (2.0 * (grid + jitter + 0.5) / size - 1.0) * [1.0, -1.0], np.linalg.inv(cameras[0]) @ cameras[1]
    clip = (np.concatenate([ndc, z, np.ones_like(z)], axis=-1) for z in (device, 1.0 - device))
    right, swapped = (_pixels(c @ again, size) - grid - jitter for c in clip)
    small = {name: _distance(undo(motion_lr), right) for name, undo in VECTORS.items()}
    depth = {"": small[""], "near and far swapped": _distance(motion_lr, swapped)}
    left = _brightness(noisy * np.exp(arrays["exposure"][number]), clean)  # the light has the exposure already
    return squares, {"motion": images, "motion_lr": small, "depth": depth, "jitter": light, "exposure": left}


def _compare_noisebase(arrays: Arrays, number: int) -> tuple[list[float], Errors]:
    """Compare a frame of data of noisebase with the one before.  -> as of ``_compare_nss``."""
    position, step = (_last(arrays[name][number][..., 0]) for name in ("position", "motion"))
    clean, before = (_last(arrays["reference"][n]) for n in (number, number - 1))
    here, then = (np.float64(arrays["view_proj_mat"][n]) for n in (number, number - 1))
    size = clean.shape[1::-1]
    pixels = _pixels(position @ here[:3] + here[3], size)
    places = {"": _distance(pixels, _grid(clean)), "those of other pixels": np.full(size[::-1], OTHER_PIXEL_PX)}
    steps = {"": step, "sign turned": -step, "y and z swapped": step[..., [0, 2, 1]], "a position": step - position}
    motions = {name: _pixels((position + s) @ then[:3] + then[3], size) - pixels for name, s in steps.items()}
    images, squares = _compare_images(clean, before, motions)
    (low, high), color = arrays["exposure"][number], np.float64(arrays["color"][number])
    noisy = color[:3] / 255.0 * np.exp((color[3] + 1.0) / 256.0 * (high - low) + low)
    return squares, {"motion": images, "position": places, "exposure": _brightness(noisy, clean)}


def _brightness(noisy: Array, clean: Array) -> dict[str, Array]:
    """Distance of the means of noisy and clean light, natural logarithm, and what it may be: few samples per pixel are
    noisy, but the means of all pixels are near each other.
    """
    return {"": np.abs(np.log([noisy.mean() / clean.mean()])), "not that of the clean light": np.log([BRIGHTNESS])}


def _compare_images(image: Array, before: Array, motions: Mapping[str, Array]) -> tuple[dict[str, Array], list[float]]:
    """Errors by each motion, and mean squared errors of the image before, unmoved and moved, of what is inside."""
    grid, shown, history = _grid(image), _shown(image), _shown(before)
    inside = np.isclose(np.clip(at := grid + motions[""], 0, np.array(shown.shape[::-1]) - 1), at).all(axis=-1)
    errors = {name: np.where(inside, np.abs(shown - _sample(history, grid + v)), np.nan) for name, v in motions.items()}
    pair = np.abs(shown - history)[inside], errors[""][inside]
    return errors, [float(np.mean(error**2)) if error.size else 0.0 for error in pair]


def _pixels(clip: Array, size: Any) -> Array:
    """Places of clip coordinates (..., 4) in the image, (..., 2) pixels, centers at integers, +y down."""
    return (clip[..., :2] / clip[..., 3:] * [0.5, -0.5] + 0.5) * size - 0.5


def _distance(one: Array, other: Array) -> Array:
    """Distance of two places (..., 2) in pixels, at most 1: a few that are far off, as at edges, do not decide."""
    return np.minimum(np.linalg.norm(one - other, axis=-1), 1.0)


def _last(image: Array) -> Array:
    """``image`` (components, h, w) with its components last, (h, w, components) float64."""
    return np.moveaxis(image.astype(np.float64), 0, -1)


def _grid(image: Array) -> Array:
    """(x, y) of the pixels of an image (h, w, ...)."""
    return np.stack(np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0])), axis=-1)


def _shown(light: Array) -> Array:
    """Mean of the display colors of exposed light (h, w, 3)."""
    return display(light).mean(axis=-1)


def _sample(image: Array, at: Array) -> Array:
    """``image`` (h, w) at ``at`` (..., 2), bilinear; outside, its edge is repeated."""
    return map_coordinates(image, [at[..., 1], at[..., 0]], order=1, mode="nearest")


# -------------------------------------------------------------------------------------------------------------- files
def _safetensors(path: Path) -> Arrays:
    """The tensors of a file by name, mapped into memory."""
    with opened(path) as file:
        data = memoryview(mmap(file.fileno(), 0, access=ACCESS_READ))
    start = 8 + int.from_bytes(data[:8], "little")
    header = parse_json(bytes(data[8:start]))
    header.pop("__metadata__", None)
    spans = {name: slice(*(start + at for at in one["data_offsets"])) for name, one in header.items()}
    flat = {name: np.frombuffer(data[spans[name]], TYPES[one["dtype"]]) for name, one in header.items()}
    return {name: values.reshape(header[name]["shape"]) for name, values in flat.items()}


def _zipped(path: Path) -> Arrays:
    """The arrays of a Zarr group in a zip by name, read frame by frame."""
    zarr = zarr_module()
    return dict(zarr.open_group(zarr.storage.ZipStore(path, mode="r"), mode="r").arrays())


_READERS = {"nss": (_safetensors, _compare_nss), "noisebase": (_zipped, _compare_noisebase)}
