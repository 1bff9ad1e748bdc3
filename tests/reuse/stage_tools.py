"""Moving frames that need every stage of a method, and their comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from taubench_gl.reuse.synthetic import Step, synthetic_steps

Array = np.ndarray


def noisy_steps(size: tuple[int, int], moving: int = 3, still: int = 3, noise: float = 0.4) -> list[Step]:
    """``moving`` frames of a fast camera, then ``still`` ones; inputs rounded to the types of their textures.

    Direct light and the rest have noise of their own; surfaces emit a little.
    """
    rng = np.random.default_rng(11)
    steps = []
    for step in synthetic_steps(size, moving, speed=3.0, noise=noise):
        inputs = stored(step.inputs)
        inputs["emission"] = (0.1 * rng.random(inputs["emission"].shape)).astype(np.float32)
        steps.append(replace(step, inputs=inputs | {"direct": _noise(inputs["direct"], rng)}))
    for index in range(moving, moving + still):
        last = steps[-1].inputs
        changed = _still(last) | {n: _noise(last[n], rng) for n in ("radiance", "direct")}
        steps.append(replace(steps[-1], index=index, inputs=last | changed))
    return steps


def stored(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """``inputs`` rounded to the types of their textures."""
    out = {n: np.asarray(v, dtype=np.uint32 if "mask" in n or "ids" in n else np.float32) for n, v in inputs.items()}
    return out | {"base_color": out["base_color"].astype(np.float16).astype(np.float32)}


def emitting_steps(size: tuple[int, int], frames: int, seed: int) -> list[Step]:
    """Noisy frames of a fast camera whose surfaces emit a little; inputs as their textures store them."""
    rng, out = np.random.default_rng(seed), []
    for step in synthetic_steps(size, frames, speed=3.0, noise=0.4):
        emission = (0.1 * rng.random(step.inputs["emission"].shape)).astype(np.float32)
        out.append(replace(step, inputs=stored(step.inputs) | {"emission": emission}))
    return out


def _noise(image: Array, rng: np.random.Generator) -> Array:
    factor = rng.gamma(16.0, 1 / 16.0, image.shape[:2])[..., None]
    return np.concatenate([image[..., :3] * factor, image[..., 3:]], axis=-1).astype(np.float32)


def _still(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """``inputs`` whose frame before has the geometry of the frame itself."""
    return {
        "motion": np.zeros_like(inputs["motion"]),
        "prev_position": inputs["position"],
        "history_position": inputs["position"],
        "history_normal": inputs["normal"],
        "history_ids": inputs["ids"],
    }


def differing(got: Array, expected: Array, atol: float = 3e-4) -> float:
    """Share of pixels whose color differs by more than rounding."""
    wrong = np.abs(got[..., :3] - expected[..., :3]) > atol + 1e-4 * np.abs(expected[..., :3])
    return float(wrong.any(axis=-1).mean())
