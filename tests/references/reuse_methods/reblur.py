"""A recurrent blur guided by hit distance, after ReBLUR (Zhdanov 2021, Ray Tracing Gems II, chapter 49).

Reference for taubench_gl/reuse/methods/reblur-class.  Inside, arrays have row 0 at the bottom, because the kernels are
turned by a hash of the pixel; ``Reblur.frame`` takes and gives images with row 0 at the top.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from references.brdf_sampling import basis_around as tangents
from references.reuse_methods.history import consistent_blend, inside, sample_history, shifted
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray
Accept = Callable[[Array, Array], Array]
TAPS, LOBES = 8, ("diffuse", "specular")
OUTSIDE_PX = -1.0e6


def kernel_angle(size: tuple[int, int], index: int, salt: int) -> Array:
    """Angle by which the kernel of each pixel is turned, radians.  ``size`` (width, height).  -> (h, w), rows up."""
    x, y = np.meshgrid(*(np.arange(n, dtype=np.uint64) for n in size))
    mask = np.uint64(0xFFFFFFFF)
    h = (x * 1973 + y * 9277 + np.uint64(index * 26699 + salt * 7919)) & mask
    h = ((h ^ (h >> np.uint64(16))) * np.uint64(0x7FEB352D)) & mask
    h = ((h ^ (h >> np.uint64(15))) * np.uint64(0x846CA68B)) & mask
    h ^= h >> np.uint64(16)
    return 6.283185307 * (h >> np.uint64(8)).astype(np.float64) / 16777216.0


def disk_offset(i: int, angle: Array) -> Array:
    """Tap i of a Vogel spiral in the unit disk.  (...) -> (..., 2)."""
    a = angle + 2.399963230 * i
    return np.sqrt((i + 0.5) / TAPS) * np.stack([np.cos(a), np.sin(a)], axis=-1)


def hit_factor(hit: Array, frustum: Array) -> Array:
    """Radius relative to the largest: hit distance over the size of what the camera sees; 1 without a hit."""
    return np.where(hit > 0, np.minimum(hit / np.where(frustum > 0, frustum, 1.0), 1.0), 1.0)


def lobe_factor(roughness: Array) -> Array:
    """Width of a glossy lobe relative to a diffuse one."""
    return np.sqrt(roughness)


def dominant_factor(roughness: Array) -> Array:
    """Lagarde and de Rousiers 2014: 1 for a mirror, whose reflection moves with what it shows, 0 for a diffuse lobe."""
    smooth = 1.0 - roughness
    return smooth * (np.sqrt(smooth) + roughness)


def to_px(clip_from_relative: Array, point: Array, near: float) -> tuple[Array, Array]:
    """Pixel coordinates as fractions of the image, y up, and whether the point is in front of the near plane.

    ``point`` (..., 3) relative to the camera.  -> (..., 2), (...) bool.
    """
    clip = np.concatenate([point, np.ones_like(point[..., :1])], axis=-1) @ clip_from_relative.T
    front = clip[..., 3] > near
    return 0.5 * clip[..., :2] / np.where(front, clip[..., 3], 1.0)[..., None] + 0.5, front


def virtual_px(frame: Mapping[str, Array], pair: Reprojection, hit: Array, roughness: Array) -> Array:
    """Where the previous camera saw the point that a surface reflects, pixels, y up; OUTSIDE_PX behind that camera.

    ``frame``: position, prev_position; ``hit``, ``roughness`` (h, w).  -> (h, w, 2).
    """
    now = frame["position"][..., :3]
    length = np.linalg.norm(now, axis=-1, keepdims=True)
    away = now / np.where(length > 0, length, 1.0)
    point = frame["prev_position"][..., :3] + away * (hit * dominant_factor(roughness))[..., None]
    at, front = to_px(pair.prev_clip_from_prev, point, pair.prev_near)
    return np.where(front[..., None], at * [pair.width, pair.height] - 0.5, OUTSIDE_PX)


@dataclass
class Reblur:
    """Frames in order; the settings are those of the method.  ``state``: what the next frame reads."""

    preblur_radius: float = 30.0
    max_radius: float = 30.0
    min_radius: float = 1.0
    post_scale: float = 2.0
    max_frames: int = 30
    disocclusion: float = 0.01
    virtual_history: bool = True
    catmull_rom: bool = True
    plane_limit: float = 0.02
    normal_limit: float = 0.2
    hit_limit: float = 1.0
    roughness_limit: float = 0.15
    fix_frames: int = 3
    fix_stride: float = 14.0
    fast_frames: int = 6
    fast_sigma: float = 2.0
    anti_firefly: bool = True
    firefly_sigma: float = 2.0
    stable_frames: int = 20
    clamp_sigma: float = 2.0
    anti_lag: float = 4.0
    state: dict[str, Array] = field(default_factory=dict)

    def frame(self, inputs: Mapping[str, Array], pair: Reprojection, index: int) -> Array:
        """``inputs``: names of reuse.frame.INPUTS, row 0 at the top.  -> (h, w, 4): linear radiance, history weight."""
        f = {n: np.asarray(v, dtype=np.float64)[::-1] for n, v in inputs.items()}
        f["motion"] = f["motion"] * [1, -1]
        self._pixel = np.linalg.norm(pair.sky_dx[:3]) * (
            np.ones_like(f["position"][..., 3]) if pair.sky_origin[3] > 0.5 else f["position"][..., 3]
        )
        self._frustum = self._pixel * min(pair.width, pair.height)
        self._rows = pair.height / 1080.0
        self._surface = f["position"][..., 3] > 0
        self._width = [np.ones(self._surface.shape), lobe_factor(f["material"][..., 1])]
        lights = self.preblurred(f, pair, index)
        lights, count, fast = self.accumulated(f, pair, lights)
        lights = self.limited(self.fixed(f, lights, count), count, fast)
        for iteration in (0, 1):
            radii = self.blur_radii(lights, count, iteration)
            lights = self.blurred(f, pair, lights, radii, index, 2 + iteration)
        self.state |= {f"{lobe} light": light for lobe, light in zip(LOBES, lights)}
        return self.stabilized(f, lights, count)[::-1]

    def preblurred(self, f: Mapping[str, Array], pair: Reprojection, index: int) -> list[Array]:
        """Lights (h, w, 4): rgb, hit distance."""
        hit = f["hit_distance"][..., :1]
        lights = [np.concatenate([f[f"{lobe}_demodulated"][..., :3], hit], axis=-1) for lobe in LOBES]
        radius = self.preblur_radius * self._rows * hit_factor(hit[..., 0], self._frustum)
        lights = self.blurred(f, pair, lights, [radius * width for width in self._width], index, 1)
        return [np.where(self._surface[..., None], light, 0.0) for light in lights]

    def blur_radii(self, lights: list[Array], count: Array, iteration: int) -> list[Array]:
        """Radii of the blur (0) and the post-blur (1), pixels."""
        scale = self._rows * (self.post_scale if iteration else 1.0)
        return [
            (self.min_radius + self.max_radius * hit_factor(light[..., 3], self._frustum)
             / np.sqrt(np.maximum(count[..., lobe], 1.0))) * self._width[lobe] * scale
            for lobe, light in enumerate(lights)
        ]  # fmt: skip

    def surface_weight(self, f: Mapping[str, Array], q: tuple[Array, Array], lobe: int) -> Array:
        """By plane distance, normal and, for specular light, roughness.  ``q``: rows, columns.  -> (h, w)."""
        n, other_n = f["normal"][..., :3], f["normal"][..., :3][q]
        apart = np.abs((n * (f["position"][..., :3][q] - f["position"][..., :3])).sum(axis=-1))
        plane = apart / np.where(self._surface, self.plane_limit * self._frustum, 1.0)
        turn = (1.0 - (n * other_n).sum(axis=-1)) / (self.normal_limit * np.maximum(self._width[lobe], 0.05))
        w = np.maximum(1.0 - plane, 0.0) * np.maximum(1.0 - turn, 0.0) * (f["position"][..., 3][q] > 0)
        if lobe == 1:
            rough = f["material"][..., 1]
            w = w * np.maximum(1.0 - np.abs(rough - rough[q]) / self.roughness_limit, 0.0)
        return w

    def blurred(
        self, f: Mapping[str, Array], pair: Reprojection, lights: list[Array], radii: list[Array], index: int, salt: int
    ) -> list[Array]:
        """Light of both lobes, blurred over disks of ``radii`` pixels in the tangent plane; that of the sky stays."""
        h, w = self._surface.shape
        normal, position = f["normal"][..., :3], f["position"][..., :3]
        t, b = tangents(normal)
        angle, out = kernel_angle((w, h), index, salt), []
        for lobe, (light, radius) in enumerate(zip(lights, radii)):
            sums, total = light.copy(), np.ones((h, w))
            for i in range(TAPS):
                o = disk_offset(i, angle)
                point = position + (radius * self._pixel)[..., None] * (o[..., :1] * t + o[..., 1:] * b)
                at, front = to_px(pair.clip_from_current, point, pair.near)
                column, row = np.moveaxis(np.floor(at * [w, h]).astype(np.int64), -1, 0)
                column, row = np.where(front, column, np.arange(w)), np.where(front, row, np.arange(h)[:, None])
                exists = (column >= 0) & (column < w) & (row >= 0) & (row < h) & self._surface
                q = np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)
                other = light[q]
                near, far = np.minimum(light[..., 3], other[..., 3]), np.maximum(light[..., 3], other[..., 3])
                weight = self.surface_weight(f, q, lobe) * np.exp(-(o**2).sum(axis=-1))
                weight = np.where(exists, weight * np.exp(-(far - near) / (self.hit_limit * far + 1e-6)), 0.0)
                sums += weight[..., None] * other
                total += weight
            out.append(sums / total[..., None])
        return out

    def accumulated(
        self, f: Mapping[str, Array], pair: Reprojection, lights: list[Array]
    ) -> tuple[list[Array], Array, Array]:
        """Temporal accumulation.

        -> lights; of both lobes the frames with this one and the mean luminance of the last few, (h, w, 2), 0 for the
        sky.
        """
        h, w = self._surface.shape
        place = np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1)
        at, virtual_at = place + f["motion"], virtual_px(f, pair, lights[1][..., 3], f["material"][..., 1])
        kept = [self.history(f, at, 0), self.specular_history(f, at, virtual_at, lights[1])]
        out, count, fast = [], np.zeros((h, w, 2)), np.zeros((h, w, 2))
        for lobe, (light, (old, frames, few)) in enumerate(zip(lights, (k[:3] for k in kept))):
            n = np.minimum(frames, self.max_frames) + 1.0
            out.append(np.where(self._surface[..., None], old + (light - old) / n[..., None], light))
            count[..., lobe] = np.where(self._surface, n, 0.0)
            few = few + (light[..., :3] @ LUMINANCE - few) / np.minimum(n, self.fast_frames + 1.0)
            fast[..., lobe] = np.where(self._surface, few, 0.0)
        return out, count, fast

    def history(self, f: Mapping[str, Array], at: Array, lobe: int) -> tuple[Array, Array, Array, Array]:
        """History of a lobe at points ``at`` (h, w, 2), y up, tap by tap.

        -> light (h, w, 4); frames times the accepted weight, luminance of the last few, accepted weight, (h, w) each.
        """
        h, w = self._surface.shape
        if not self.state:
            return np.zeros((h, w, 4)), np.zeros((h, w)), np.zeros((h, w)), np.zeros((h, w))
        normal, then = f["normal"][..., :3], f["prev_position"][..., :3]

        def accept(row: Array, column: Array) -> Array:
            there = f["history_position"][row, column]
            apart = np.abs((normal * (there[..., :3] - then)).sum(axis=-1))
            return (there[..., 3] > 0) & (apart <= self.disocclusion * self._frustum)

        seen = inside(at, (w, h)) & self._surface
        at = np.where(seen[..., None], at, 0.0)
        light = self.state[f"{LOBES[lobe]} light"]
        sums = [self.state[name][..., lobe, None] for name in ("frames", "fast")]
        blend, total = consistent_blend(np.concatenate([light, *sums], axis=-1), at, accept)
        if self.catmull_rom:
            sharp = sample_history(light[::-1], at * [1, -1] + [0, h - 1], "catmull_rom")[..., :3]
            whole = (total > 0) & self._wide(at, accept)
            blend[..., :3] = np.where(whole[..., None], np.maximum(sharp, 0.0), blend[..., :3])
        found = np.where(seen[..., None], blend, 0.0)
        total = np.where(seen, total, 0.0)
        return found[..., :4], found[..., 4] * total, found[..., 5], total

    def _wide(self, at: Array, accept: Accept) -> Array:
        """Whether 4x4 taps without the corners are inside the image and accepted.  -> (h, w) bool."""
        h, w = self._surface.shape
        base, good = np.floor(at).astype(np.int64), np.ones((h, w), dtype=bool)
        for dy in range(-1, 3):
            for dx in range(-1, 3):
                if dx in (-1, 2) and dy in (-1, 2):
                    continue
                column, row = base[..., 0] + dx, base[..., 1] + dy
                there = (column >= 0) & (column < w) & (row >= 0) & (row < h)
                good &= there & accept(np.clip(row, 0, h - 1), np.clip(column, 0, w - 1))
        return good

    def specular_history(
        self, f: Mapping[str, Array], at: Array, virtual_at: Array, specular: Array
    ) -> tuple[Array, Array, Array]:
        """Specular history along the surface and along what it reflects, by the confidence in the latter.

        -> light (h, w, 4), frames (h, w), luminance of the last few (h, w).
        """
        h, w = self._surface.shape
        dominant = dominant_factor(f["material"][..., 1])
        light, frames, few, total = self.history(f, at, 1)
        seen_light, seen_frames, seen_few, seen_total = self.history(f, virtual_at, 1)
        column, row = np.moveaxis(np.floor(virtual_at + 0.5).astype(np.int64), -1, 0)
        normal = f["history_normal"][np.clip(row, 0, h - 1), np.clip(column, 0, w - 1), :3]
        turn = 1.0 - (normal * f["normal"][..., :3]).sum(axis=-1)
        near = np.maximum(1.0 - turn / (self.normal_limit * np.maximum(self._width[1], 0.05)), 0.0)
        hits = np.stack([specular[..., 3], seen_light[..., 3]])
        alike = np.exp(-np.abs(hits[0] - hits[1]) / (self.hit_limit * hits.max(axis=0) + 1e-6))
        confidence = dominant * seen_total * alike * near * self.virtual_history
        apart = np.minimum(np.linalg.norm(at - virtual_at, axis=-1), 1e3)
        frames = np.minimum(frames, self.max_frames) / (1.0 + dominant * apart)
        frames = frames + confidence * (seen_frames - frames)
        part = np.where(total > 0, confidence, confidence > 0)
        return light + part[..., None] * (seen_light - light), frames, few + part * (seen_few - few)

    def fixed(self, f: Mapping[str, Array], lights: list[Array], count: Array) -> list[Array]:
        """History fix: sparse 5x5 taps for pixels with few frames."""
        h, w = self._surface.shape
        rows, columns = np.mgrid[:h, :w]
        out = []
        for lobe, light in enumerate(lights):
            few = self._surface & (count[..., lobe] <= self.fix_frames + 0.5)
            wide = self.fix_stride * self._rows / np.maximum(count[..., lobe], 1.0)
            stride = np.maximum(np.floor(wide + 0.5).astype(np.int64), 1)
            sums, total = np.zeros_like(light), np.zeros((h, w))
            for dy in range(-2, 3):
                for dx in range(-2, 3):
                    row, column = rows + stride * dy, columns + stride * dx
                    exists = (row >= 0) & (row < h) & (column >= 0) & (column < w)
                    q = np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)
                    weight = np.where(exists, self.surface_weight(f, q, lobe), 0.0)
                    sums += weight[..., None] * light[q]
                    total += weight
            mean = sums / np.where(total > 0, total, 1.0)[..., None]
            out.append(np.where(few[..., None], mean, light))
        return out

    def limited(self, lights: list[Array], count: Array, fast: Array) -> list[Array]:
        """Luminance limited by anti-firefly, then by the fast history; writes the fast history of the next frame."""
        out, kept = [], np.zeros_like(fast)
        for lobe, light in enumerate(lights):
            few, before = fast[..., lobe], np.maximum(count[..., lobe] - 1.0, 0.0)
            lit = light[..., :3] @ LUMINANCE
            limited = lit
            if self.anti_firefly:
                mean, sigma = self.local_range(few, reach=4, hole=1)
                limited = np.clip(limited, mean - self.firefly_sigma * sigma, mean + self.firefly_sigma * sigma)
            part = np.clip(before / max(self.fix_frames, 1e-6), 0.0, 1.0)
            kept[..., lobe] = np.where(self._surface, limited + part * (few - limited), 0.0)
            if self.fast_frames < self.max_frames:
                mean, sigma = self.local_range(few, reach=2)
                inner = np.clip(limited, mean - self.fast_sigma * sigma, mean + self.fast_sigma * sigma)
                limited = inner + (limited - inner) / (1.0 + 2.0 * before)
            scale = np.where(self._surface & (lit > 0), limited / np.where(lit > 0, lit, 1.0), 1.0)
            out.append(np.concatenate([light[..., :3] * scale[..., None], light[..., 3:]], axis=-1))
        self.state["fast"] = kept
        return out

    def local_range(self, luminance: Array, reach: int = 1, hole: int = -1) -> tuple[Array, Array]:
        """Mean and standard deviation over the surface pixels within ``reach`` of each pixel, without those within
        ``hole``; a deviation of 1e30 where there are none.  (h, w) -> (h, w), (h, w)."""
        sums = np.zeros((*luminance.shape, 3))
        values = np.stack([np.ones_like(luminance), luminance, luminance**2], axis=-1) * self._surface[..., None]
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                if max(abs(dx), abs(dy)) > hole:
                    other, exists = shifted(values, dx, dy)
                    sums += other * exists[..., None]
        count = np.where(sums[..., 0] > 0, sums[..., 0], 1.0)
        mean = sums[..., 1] / count
        sigma = np.sqrt(np.maximum(sums[..., 2] / count - mean**2, 0.0))
        return mean, np.where(sums[..., 0] > 0, sigma, 1e30)

    def stabilized(self, f: Mapping[str, Array], lights: list[Array], count: Array) -> Array:
        """Temporal stabilization, anti-lag and modulation.  -> the result (h, w, 4), rows up."""
        h, w = self._surface.shape
        at = np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1) + f["motion"]
        seen = inside(at, (w, h)) & ("stable" in self.state)
        before = np.zeros((h, w, 2))
        if "stable" in self.state:
            down = at * [1, -1] + [0, h - 1]
            before = sample_history(self.state["stable"][::-1], np.where(seen[..., None], down, 0.0))
        stable, frames, parts = np.zeros((h, w, 2)), np.zeros((h, w, 2)), []
        for lobe, light in enumerate(lights):
            l = light[..., :3] @ LUMINANCE  # noqa: E741
            mean, sigma = self.local_range(l)
            inner = np.clip(before[..., lobe], mean - self.clamp_sigma * sigma, mean + self.clamp_sigma * sigma)
            lag = np.abs(before[..., lobe] - inner) / np.maximum(np.maximum(before[..., lobe], l), 1e-6)
            n = np.minimum(count[..., lobe] - 1.0, self.stable_frames)
            used = seen & self._surface & (count[..., lobe] >= 1.5)
            trust = np.where(used, 1.0 / (1.0 + self.anti_lag * lag), 1.0)
            mixed = l + (inner - l) * trust * n / np.where(used, 1.0 + n, 1.0)
            stable[..., lobe] = np.where(self._surface, np.where(used, mixed, l), 0.0)
            frames[..., lobe] = count[..., lobe] * trust
            scale = np.where(l > 0, stable[..., lobe] / np.where(l > 0, l, 1.0), 1.0)
            parts.append(light[..., :3] * scale[..., None] * f[f"{LOBES[lobe]}_albedo"][..., :3])
        self.state |= {"stable": stable, "frames": frames}
        surface = self._surface[..., None]
        color = np.where(surface, np.maximum(sum(parts) + f["emitted"][..., :3], 0.0), f["emitted"][..., :3])
        part = np.maximum(np.stack([p @ LUMINANCE for p in parts], axis=-1), 1e-9)
        kept = (part * (1.0 - 1.0 / np.maximum(count, 1.0))).sum(axis=-1) / part.sum(axis=-1)
        return np.concatenate([color, np.where(self._surface, kept, 0.0)[..., None]], axis=-1)
