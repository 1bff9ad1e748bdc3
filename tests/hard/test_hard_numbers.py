"""Functions of the CPU, on which shaders depend, against SciPy, closed forms and definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fixed import fixed_settings
from scipy.spatial.transform import Rotation

from taubench_gl import math3d
from taubench_gl.evaluation import schedule
from taubench_gl.frame.materials import texels_at
from taubench_gl.frame.passes import indirect
from taubench_gl.frame.plan import frame_spec
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.metrics import environment
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Sampler, Scene, Texture


def test_rotations_against_scipy() -> None:
    """Random quaternions, and those whose largest component is at each place with each sign."""
    rng = np.random.default_rng(1)
    near = np.concatenate([np.eye(4), -np.eye(4)]) + 0.1 * rng.normal(size=(8, 4))
    first, second = (math3d.normalize(np.concatenate([rng.normal(size=(20, 4)), near])) for _ in range(2))
    a, b = Rotation.from_quat(first), Rotation.from_quat(second)
    assert math3d.mat3_from_quat(2.5 * first) == pytest.approx(a.as_matrix(), abs=1e-14)
    for p, q, r, s in zip(first, second, a, b, strict=True):
        matrix, scale, point = r.as_matrix(), rng.normal(size=3), rng.normal(size=(2, 3))
        assert math3d.mat3_from_quat(math3d.quat_multiply(p, q)) == pytest.approx((r * s).as_matrix(), abs=1e-14)
        assert math3d.quat_from_mat3(matrix) == pytest.approx(p * (1 if p[3] >= 0 else -1), abs=1e-12)
        vector = r.as_rotvec()
        turned = math3d.quat_from_axis_angle(3.0 * vector, float(np.linalg.norm(vector)))
        assert math3d.quat_angle(turned, -p) == pytest.approx(0.0, abs=1e-12)
        assert math3d.quat_angle(p, q) == pytest.approx((r.inv() * s).magnitude(), abs=1e-12)
        stretched = matrix @ np.diag(scale) @ s.as_matrix()
        cofactors = np.linalg.inv(stretched).T * abs(np.linalg.det(stretched))
        assert math3d.normal_matrix(stretched) == pytest.approx(cofactors, rel=1e-9, abs=1e-12)
        moved = math3d.transform_points(math3d.trs(point[0], p, scale), point[1])
        assert moved == pytest.approx(r.apply(scale * point[1]) + point[0], abs=1e-12)


@pytest.mark.parametrize("far", [50.0, math.inf])
def test_corners_of_the_view(far: float) -> None:
    """Depth 1 at the near plane and 0 at the far one; a corner of the view at (1, -1)."""
    tangent, lens = math.tan(0.35), math3d.perspective_reversed(0.7, 1.5, 0.5, far)
    for depth, z in ((0.5, 1.0), (50.0, 0.0 if far == 50.0 else 0.01)):
        clip = lens @ [1.5 * tangent * depth, -tangent * depth, -depth, 1.0]
        assert clip / clip[3] == pytest.approx([1.0, -1.0, z, 1.0], abs=1e-12)
        if far == 50.0:
            flat = math3d.orthographic_reversed(3.0, 2.0, 0.5, far) @ [3.0, -2.0, -depth, 1.0]
            assert flat == pytest.approx([1.0, -1.0, z, 1.0], abs=1e-12)


@pytest.mark.parametrize(
    ("wrap", "columns", "rows"),
    [(10497, [2, 0, 0, 2, 0], [1, 4, 1, 4, 0]), (33071, [0, 0, 3, 3, 0], [1, 4, 0, 4, 4]),
     (33648, [1, 0, 3, 2, 0], [1, 0, 3, 4, 4])],
)  # fmt: skip
def test_texels_of_wrapped_coordinates(wrap: int, columns: list[int], rows: list[int]) -> None:
    uv = np.array([[-0.3, 0.3], [0.05, 1.9], [1.2, -0.7], [2.7, 0.99], [np.nan, 1.0]])
    at = texels_at(Texture(0, Sampler(wrap_s=wrap, wrap_t=wrap)), uv, (4, 5))
    assert [x.tolist() for x in at] == [columns, rows]


@pytest.mark.parametrize("positions", [(0,), (0, 1, 2), (1, 4, 5, 9)])
def test_both_frames_of_a_pair_are_drawn(positions: tuple[int, ...]) -> None:
    drawn = schedule.pair_schedule(range(100, 120), positions)
    assert [frame - 101 for frame, evaluated in drawn if evaluated] == list(positions)
    assert [frame for frame, _ in drawn] == sorted({100 + p + k for p in positions for k in (0, 1)})


def lamps(points: int, suns: int) -> Scene:
    """A closed room with lamps of decreasing power, and directional lights after them."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((4.0, 2.0, 1.0), inside=True)), translation=(10.0, 0.0, 0.0))
    for i in range(points + suns):
        b.light(kind="point" if i < points else "directional", intensity=100.0 / (i + 1), translation=(10.0, 0.0, 0.0))
    b.camera(translation=(10.0, 0.0, 0.0))
    return b.build()


@pytest.mark.parametrize(
    ("points", "suns", "samples"),
    [(3, 0, 96), (3, 0, 191), (3, 0, 192), (3, 0, 288), (3, 0, 95), (3, 0, 5000), (1, 1, 351), (1, 1, 352),
     (1, 1, 2200)],
)  # fmt: skip
def test_sizes_of_indirect_light(points: int, suns: int, samples: int) -> None:
    """Lights have maps while each side has 4 texels: six sides of a lamp, one of a sun, which is four times as long."""
    spec = frame_spec(AnimatedScene(lamps(points, suns)), fixed_settings(
        indirect="probes", width=70, height=41, indirect_samples=samples,
        probes=300, columns=("direct", "indirect"),
    ))  # fmt: skip
    sides = [6] * points + [16] * suns  # texels of a light at a resolution of 1
    fitting = max(n for n in range(len(sides) + 1) if 16 * sum(sides[:n]) <= samples)
    used = sum(sides[:fitting])
    side, patches = math.isqrt(samples // used) if used else 2, 0 if fitting == len(sides) else (samples + 1) // 2
    assert indirect.mapped_lights(spec) == list(range(fitting))
    assert not used or indirect.rsm_resolution(spec) == side
    assert (indirect.patch_count(spec), indirect.vpl_count(spec)) == (patches, used * side**2 + 2 * patches)
    layout, extent = indirect.indirect_layout(spec.animated.box, spec.size, 300), np.array([8.0, 4.0, 2.0])
    counts = np.ceil(extent / (64.0 / 300) ** (1 / 3))
    assert layout["probe_counts"][:3].tolist() == counts.tolist() and layout["size"].tolist() == [70, 41, 9, 6]
    assert layout["probe_step"][:3] == pytest.approx(extent / counts, abs=1e-6)
    assert layout["probe_origin"][:3] == pytest.approx(0.5 * (extent / counts - extent), abs=1e-6)
    assert layout["grid_origin"] == pytest.approx([*(-0.5 * extent - 8.16 / 94), 8.16 / 94], abs=1e-6)
    assert indirect.scene_center(spec) == pytest.approx([10.0, 0.0, 0.0])


def linear_sky(direction: np.ndarray) -> np.ndarray:
    """Radiance that is linear in the direction, so that every lobe of it has a closed form.  (..., 3) -> (..., 3)."""
    return 1.0 + direction @ np.array([[0.3, 0.1, -0.2], [0.2, -0.4, 0.1], [-0.1, 0.2, 0.3]])


def test_directions_and_lookups_of_a_linear_sky() -> None:
    """Rows from the pole +Y, columns from -X over +Z; bilinear between texels and across the seam."""
    height = 64
    theta, phi = (np.arange(height) + 0.5) * np.pi / height, (np.arange(2 * height) + 0.5) * np.pi / height - np.pi
    d = np.stack([np.outer(np.sin(theta), np.cos(phi)), np.outer(np.cos(theta), np.ones(2 * height)),
                  np.outer(np.sin(theta), np.sin(phi))], axis=-1)  # fmt: skip
    sky = linear_sky(d)
    assert environment.directions(height) == pytest.approx(d, abs=1e-12)
    assert environment.solid_angles(height).sum() * 2 * height == pytest.approx(4.0 * np.pi, rel=1e-3)
    middle, across = (math3d.normalize(a + b) for a, b in ((d[20:40, :-1], d[20:40, 1:]), (d[10, 0], d[10, -1])))
    assert environment.lookup(sky, d) == pytest.approx(sky, abs=2e-3)
    assert environment.lookup(sky, middle) == pytest.approx(0.5 * (sky[20:40, :-1] + sky[20:40, 1:]), abs=2e-3)
    assert environment.lookup(sky, across) == pytest.approx(0.5 * (sky[10, 0] + sky[10, -1]), abs=2e-3)


def test_lobes_of_a_linear_sky() -> None:
    """Diffuse irradiance over pi is 1 + 2/3 a . n; a GGX lobe keeps a share of a . n that a quadrature gives."""
    sky, there = linear_sky(environment.directions(64)), linear_sky(environment.directions(32))
    diffuse = environment.zonal_filter(sky, environment.cosine_lobe, 32)
    assert diffuse == pytest.approx(1.0 + 2.0 / 3.0 * (there - 1.0), abs=2e-3)
    mu = (np.arange(4000) + 0.5) / 4000
    for roughness in (0.5, 0.9):
        lobe = mu / ((0.5 * (1.0 + mu)) * (roughness**4 - 1.0) + 1.0) ** 2
        share = float((lobe * mu).sum() / lobe.sum())
        blurred = environment.zonal_filter(sky, environment.ggx_lobe(roughness), 32)
        assert blurred == pytest.approx(1.0 + share * (there - 1.0), abs=2e-3)


def test_probabilities_of_directions_are_those_of_the_power() -> None:
    sky, omega = linear_sky(environment.directions(64)), environment.solid_angles(64)
    choice, power = environment.direction_choice(sky).astype(np.float64), sky @ np.array([0.2126, 0.7152, 0.0722])
    rows = np.cumsum((power * omega[:, None]).sum(axis=1))
    assert choice[:, :-1, 1] == pytest.approx(power / rows[-1], rel=1.2e-2)  # bilinear texels are likely at their rims
    assert choice[:, -1, 0] == pytest.approx(rows / rows[-1], abs=2e-3)
    assert choice[:, :-1, 0] == pytest.approx(np.cumsum(power, axis=1) / power.sum(axis=1)[:, None], abs=2e-3)
    dark = environment.direction_choice(np.zeros((16, 32, 3)))[:, :-1, 1]
    assert dark == pytest.approx(np.full(dark.shape, 0.25 / np.pi), rel=2e-3)
