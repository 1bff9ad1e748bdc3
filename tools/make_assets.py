"""assets/demo.glb (``tools/record assets``): a courtyard with moving objects of every kind, lights, walking camera."""

from __future__ import annotations

import math

import numpy as np
from light_kit import turn
from shapes import Shape, box, join, moved, quad, sphere, tube

from taubench_gl.datasets.gltf_writer import Writer

DURATION = 2.5
SKY = "0.13,0.23,0.46"
"""Radiance of the evening sky, the same in every direction."""

LICENSE = "CC0-1.0, made for taubench-gl"


def times(count: int) -> np.ndarray:
    return np.linspace(0.0, DURATION, count)


# ---------------------------------------------------------------------------------------------------------- textures
def bricks(size: int = 128) -> tuple[np.ndarray, np.ndarray]:
    """Color and height of a seamless brick wall: (h, w, 3) uint8 and (h, w) float."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[0:size, 0:size]
    row = y // (size // 8)
    column = ((x + (row % 2) * (size // 8)) % size) // (size // 4)
    inside_y, inside_x = y % (size // 8), (x + (row % 2) * (size // 8)) % (size // 4)
    edge = np.minimum.reduce([inside_x, size // 4 - 1 - inside_x, inside_y, size // 8 - 1 - inside_y])
    height = np.clip(edge / 2.0, 0, 1)
    tone = rng.uniform(0.75, 1.1, (8, 4))[row, column][..., None]
    brick, mortar = np.array([142, 86, 66]) * tone, np.array([190, 182, 168])
    color = np.where((height > 0.2)[..., None], brick, mortar)
    return (np.clip(color, 0, 255) // 8 * 8).astype(np.uint8), height


def normal_map(height: np.ndarray, strength: float) -> np.ndarray:
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * strength
    dy = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * strength
    n = np.stack([-dx, dy, np.ones_like(dx)], axis=-1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return np.round((n * 0.5 + 0.5) * 255).astype(np.uint8)


def tiles(size: int = 128) -> np.ndarray:
    """Terracotta and slate, four by four, no two of one tone."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[0:size, 0:size]
    side = size // 4
    row, column = y // side, x // side
    tone = rng.uniform(0.82, 1.12, (4, 4))[row, column][..., None]
    color = np.where(((row + column) % 2 == 0)[..., None], [124, 84, 64], [80, 84, 92]) * tone
    joint = (x % side < 1) | (y % side < 1)
    return (np.where(joint[..., None], [58, 54, 50], color) // 4 * 4).astype(np.uint8)


def leaves(size: int = 64) -> np.ndarray:
    """A spray of leaves with alpha."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:size, 0:size] / size
    out = np.zeros((size, size, 4), np.uint8)
    for _ in range(26):
        at, turned = rng.uniform(0.12, 0.88, 2), rng.uniform(0, math.pi)
        along = (x - at[0]) * math.cos(turned) + (y - at[1]) * math.sin(turned)
        across = (y - at[1]) * math.cos(turned) - (x - at[0]) * math.sin(turned)
        leaf = (along / 0.11) ** 2 + (across / 0.045) ** 2 < 1
        out[leaf] = (*(np.array([70, 104, 44]) * rng.uniform(0.7, 1.25)).astype(int), 255)
    return out


def lattice(size: int = 64) -> np.ndarray:
    """A garden trellis with alpha: opaque wood, transparent gaps."""
    y, x = np.mgrid[0:size, 0:size]
    slat = ((x + y) % (size // 4) < 5) | ((x - y) % (size // 4) < 5)
    over = (x + y) % (size // 4) < 5
    color = np.where(over[..., None], [150, 108, 62], [118, 82, 46])
    return np.dstack([color, np.where(slat, 255, 0)]).astype(np.uint8)


# ------------------------------------------------------------------------------------------------------------ objects
def tentacle_shape(height: float, joints: int) -> Shape:
    """A tapered tube along +Y; every ring is skinned to the two adjacent joints."""
    heights = np.linspace(0, height, 33)
    shape = tube(0.05 + 0.3 * (1 - heights / height) ** 0.7, heights)
    along = np.clip(shape["POSITION"][:, 1] / height * joints - 0.5, 0, joints - 1)
    low = np.minimum(along.astype(int), joints - 2)
    upper = along - low
    zero = np.zeros_like(low)
    shape["JOINTS_0"] = np.stack([low, low + 1, zero, zero], axis=-1)
    shape["WEIGHTS_0"] = np.stack([1 - upper, upper, zero, zero], axis=-1)
    return shape


def add_tentacle(w: Writer, material: int, at, height: float = 2.6, joints: int = 6) -> list[tuple]:
    step = height / joints
    parent = w.node("tentacle", translation=list(at))
    nodes = []
    for i in range(joints):
        parent = w.node(f"joint {i}", parent, translation=[0.0, step if i else 0.0, 0.0])
        nodes.append(parent)
    # A joint binds at the start of its segment; the transform of the skinned node has no effect.
    inverse = np.tile(np.eye(4), (joints, 1, 1))
    inverse[:, 1, 3] = -step * np.arange(joints)
    skin = w.skin("tentacle", nodes, inverse)
    mesh = w.mesh("tentacle", w.primitive(tentacle_shape(height, joints), material))
    w.node("tentacle skin", mesh=mesh, skin=skin)
    t = times(21)
    phase = 2 * math.pi * t / DURATION
    return [
        (n, "rotation", t, turn("z", 16 * np.sin(2 * phase - 0.7 * i) * (i > 0) + 4 * i), "LINEAR")
        for i, n in enumerate(nodes)
    ]


def add_morph(w: Writer, material: int, at) -> list[tuple]:
    """A ball that becomes a cube, then a bud."""
    ball = sphere(0.55, 16, 28)
    p = ball["POSITION"]
    cube = p / np.abs(p).max(axis=-1, keepdims=True) * 0.5
    bud = p * (1 + 0.35 * np.sin(5 * np.arctan2(p[:, 2], p[:, 0])) * (1 - (p[:, 1] / 0.55) ** 2))[:, None]
    flat_normal = np.round(p / np.abs(p).max(axis=-1, keepdims=True) * 0.51)
    flat_normal /= np.maximum(np.linalg.norm(flat_normal, axis=-1, keepdims=True), 1e-9)
    targets = [
        {"POSITION": cube - p, "NORMAL": flat_normal - ball["NORMAL"]},
        {"POSITION": bud - p, "NORMAL": np.zeros_like(p)},
    ]
    mesh = w.mesh("morph", w.primitive(ball, material, targets), weights=[0.0, 0.0])
    node = w.node("morph", mesh=mesh, translation=list(at))
    weights = np.array([[0, 0], [1, 0], [1, 0], [0, 1], [0, 0]], dtype=float)
    return [
        (node, "weights", times(5), weights, "LINEAR"),
        (node, "rotation", times(5), turn("y", [0, 60, 120, 180, 240]), "LINEAR"),
    ]


def add_carousel(w: Writer, metal: int, paints: list[int], at) -> list[tuple]:
    """A rotating cross that carries counter-rotating boxes: motion of a node, of its parent, and of both."""
    pole = w.mesh("post", w.primitive(box((-0.12, 0, -0.12), (0.12, 2.1, 0.12)), metal))
    post = w.node("post", translation=list(at), mesh=pole)
    arms = join([box((-1.5, -0.06, -0.06), (1.5, 0.06, 0.06)), box((-0.06, -0.06, -1.5), (0.06, 0.06, 1.5))])
    hub = w.node("carousel", post, translation=[0.0, 2.1, 0.0], mesh=w.mesh("arms", w.primitive(arms, metal)))
    cars = [
        w.mesh(f"car {i}", w.primitive(box((-0.28, -0.28, -0.28), (0.28, 0.28, 0.28)), m)) for i, m in enumerate(paints)
    ]
    t = times(6)
    tracks = [(hub, "rotation", t, turn("y", 72.0 * np.arange(6)), "LINEAR")]
    for i, (x, z) in enumerate(((1.5, 0), (0, 1.5), (-1.5, 0), (0, -1.5))):
        car = w.node(f"car {i}", hub, translation=[x, -0.45, z], mesh=cars[i % len(cars)])
        tracks.append((car, "rotation", t, turn("y", -72.0 * np.arange(6)), "LINEAR"))
    return tracks


def add_ball(w: Writer, material: int) -> list[tuple]:
    """A ball that bounces across the court: CUBICSPLINE keys with the tangents of the parabola."""
    node = w.node("ball", mesh=w.mesh("ball", w.primitive(sphere(0.3, 12, 20), material)))
    count, span, peak = 4, DURATION / 4, 1.4
    keys = []
    for i in range(2 * count + 1):
        x = -1.6 + 7.0 * i / (2 * count)
        up = 0.3 if i % 2 == 0 else 0.3 + peak
        rise = 4 * peak / span  # speed of the parabola at the ground
        speed = 7.0 / DURATION
        arriving, leaving = (-rise, rise) if i % 2 == 0 else (0.0, 0.0)
        keys.append([[speed, arriving, 0], [x, up, 1.9], [speed, leaving, 0]])
    return [(node, "translation", times(2 * count + 1), np.array(keys).reshape(-1, 3), "CUBICSPLINE")]


def tree(rng: np.random.Generator, at, height: float) -> tuple[Shape, Shape]:
    """A trunk in a pot, and its crown: cards of leaves on a ball, facing outwards.  (wood, leaves)."""
    pot = tube(np.array([0.2, 0.24, 0.3, 0.3]), np.array([0.0, 0.2, 0.45, 0.5]))
    trunk = tube(np.array([0.06, 0.045, 0.03]), np.array([0.45, 0.7 * height, height]))
    cards = []
    for _ in range(48):
        out = rng.normal(size=3)
        out /= np.linalg.norm(out)
        side = np.cross(out, rng.normal(size=3))
        side *= 0.62 / np.linalg.norm(side)
        up = np.cross(out, side)
        middle = np.array([0.0, height, 0.0]) + 0.48 * out * [1.0, 1.25, 1.0]
        cards.append(quad(middle - 0.5 * (side + up), side, up, 1 / 0.62))
    return moved(join([pot, trunk]), at), moved(join(cards), at)


def add_trees(w: Writer, wood: int) -> None:
    """Four of them, at corners of the basin and before the arcade."""
    rng = np.random.default_rng(4)
    crown = w.material("leaves", texture=w.texture(leaves()), roughness=0.8, alphaMode="MASK", doubleSided=True)
    places = ((-6.6, 0, -2.9, 1.9), (-6.6, 0, 2.9, 1.7), (-0.9, 0, -3.3, 1.6), (6.9, 0, 3.0, 1.8))
    grown = [tree(rng, place[:3], place[3]) for place in places]
    parts = [join([one[k] for one in grown]) for k in (0, 1)]
    w.node("trees", mesh=w.mesh("trees", w.primitive(parts[0], wood), w.primitive(parts[1], crown)))


def add_court(w: Writer) -> None:
    color, height = bricks()
    wall = w.material("brick", texture=w.texture(color), normal=w.texture(normal_map(height, 1.5)), roughness=0.9)
    floor = w.material("tiles", texture=w.texture(tiles()), roughness=0.5)
    plaster = w.material("plaster", (0.6, 0.55, 0.46), roughness=0.95)
    wood = w.material("trellis", texture=w.texture(lattice()), alphaMode="MASK", doubleSided=True)
    wood_dark = w.material("wood", (0.25, 0.14, 0.07), roughness=0.7)
    water = w.material("water", (0.02, 0.1, 0.13), roughness=0.08)
    walls = box((-8, 0, -6), (8, 4.2, 6), 0.5, inside=True, faces="xXzZ")
    ground = quad((-8, 0, 6), (16, 0, 0), (0, 0, -12), 0.25)
    w.node("court", mesh=w.mesh("court", w.primitive(walls, wall), w.primitive(ground, floor)))
    places = [(x, z) for x in (-5.2, -2.6, 0, 2.6, 5.2) for z in (-4.2, 4.2)]
    columns = [box((x - 0.22, 0, z - 0.22), (x + 0.22, 3.0, z + 0.22)) for x, z in places]
    beams = [box((-8, 3.0, z - 0.3), (8, 3.35, z + 0.3)) for z in (-4.2, 4.2)]
    roofs = [box((-8, 3.35, -6), (8, 3.5, -3.8)), box((-8, 3.35, 3.8), (8, 3.5, 6))]
    w.node(
        "arcade",
        mesh=w.mesh("arcade", w.primitive(join([*columns, *beams]), plaster), w.primitive(join(roofs), wood_dark)),
    )
    rim = [
        box((-5.3, 0, -1.5), (-5.1, .5, 1.5)), box((-2.3, 0, -1.5), (-2.1, .5, 1.5)),
        box((-5.3, 0, 1.5), (-2.1, .5, 1.7)), box((-5.3, 0, -1.7), (-2.1, .5, -1.5)),
    ]  # fmt: skip
    pool = quad((-5.1, 0.35, 1.5), (2.8, 0, 0), (0, 0, -3.0))
    w.node("basin", mesh=w.mesh("basin", w.primitive(join(rim), plaster), w.primitive(pool, water)))
    screens = [quad((x, 0, -4.2), (2.16, 0, 0), (0, 2.2, 0), 0.8) for x in (-4.98, 2.82)]
    w.node("trellis", mesh=w.mesh("trellis", w.primitive(join(screens), wood)))
    steps = [moved(box((0, 0, 0), (1.6, 0.25 * (i + 1), 0.4)), (6.2, 0, -2.4 + 0.4 * i)) for i in range(6)]
    w.node("steps", mesh=w.mesh("steps", w.primitive(join(steps), plaster)))
    add_trees(w, wood_dark)


def add_lights(w: Writer) -> list[tuple]:
    """A sun, two static lamps, a moving one, one that is switched by its scale, and a rotating spot light."""
    glow = w.material("glow", (1.0, 0.9, 0.7), emissiveFactor=[1.0, 0.75, 0.4])
    bulb = w.mesh("bulb", w.primitive(sphere(0.1, 8, 12), glow))
    sun = w.light(type="directional", name="sun", color=[1.0, 0.8, 0.58], intensity=8.3)
    w.node("sun", rotation=[-0.454519, 0.270598, 0.146447, 0.835600], extensions=sun)
    lamp = w.light(type="point", name="lamp", color=[1.0, 0.75, 0.45], intensity=33.0, range=12.0)
    for i, x in enumerate((-6.5, 4.0)):
        hang(w, w.node(f"lamp {i}", translation=[x, 2.6, -5.2], mesh=bulb), lamp)
    spark = w.light(type="point", name="spark", color=[0.4, 0.7, 1.0], intensity=33.0, range=10.0)
    flying = w.node("spark", mesh=bulb)
    hang(w, flying, spark)
    t = times(26)
    phase = 2 * math.pi * t / DURATION
    path = np.stack([2.5 + 3 * np.cos(phase), 1.6 + 0.5 * np.sin(3 * phase), 3 * np.sin(phase)], axis=-1)
    flash = w.light(type="point", name="flash", color=[1.0, 0.3, 0.2], intensity=39.0, range=10.0)
    switched = w.node("flash", translation=[0.0, 2.6, -5.2], scale=[0.0, 0.0, 0.0], mesh=bulb)
    hang(w, switched, flash)
    states = np.repeat([0.0, 1.0, 0.0], 3).reshape(3, 3)
    cone = {"innerConeAngle": 0.25, "outerConeAngle": 0.5}
    spot = w.light(type="spot", name="searchlight", color=[1.0, 1.0, 0.9], intensity=167.0, range=20.0, spot=cone)
    search = w.node("searchlight", translation=[7.0, 4.0, 0.0], extensions=spot)
    sweep = [turn("y", a) for a in (60.0, 120.0, 60.0)]
    down = turn("x", -35.0)
    return [
        (flying, "translation", t, path, "LINEAR"),
        (switched, "scale", [0.0, 0.9, 1.8], states, "STEP"),
        (search, "rotation", times(3), np.array([multiply(q, down) for q in sweep]), "LINEAR"),
    ]


def hang(w: Writer, bulb: int, light: dict) -> None:
    """Add a light below its bulb: inside, the mesh of the bulb would shadow it."""
    w.node("light", bulb, translation=[0.0, -0.15, 0.0], extensions=light)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of two quaternions xyzw: rotation b first."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def add_camera(w: Writer) -> list[tuple]:
    """Walks along the arcade and turns into the court, at eye height, with vertical bobbing."""
    walker = w.node("walker")
    w.node("eye", walker, camera=w.camera("walk", math.radians(55), 0.1, 100.0), rotation=turn("x", -6.0).tolist())
    t = times(31)
    s = t / DURATION
    ease = s * s * (3 - 2 * s)
    between = np.clip((s - 0.25) / 0.5, 0, 1)  # past one column, before the next
    inwards = between * between * (3 - 2 * between)
    path = np.stack([6.8 - 6.2 * ease, 1.65 + 0.04 * np.sin(2 * math.pi * 1.8 * t), 5.2 - 2.0 * inwards], axis=-1)
    return [
        (walker, "translation", t, path, "LINEAR"),
        (walker, "rotation", t, turn("y", 58.0 - 70.0 * ease), "LINEAR"),
    ]


def demo() -> Writer:
    """The complete scene, with one animation per object, all played together, as Blender writes them."""
    w = Writer(LICENSE, "taubench-gl tools/make_assets.py")
    add_court(w)
    metal = w.material("brass", (0.9, 0.65, 0.3), metallic=1.0, roughness=0.3)
    paints = [w.material(f"paint {i}", c, roughness=0.35) for i, c in enumerate(((0.45, 0.07, 0.05), (0.08, 0.2, 0.5)))]
    skin = w.material("tentacle", (0.35, 0.16, 0.4), roughness=0.5)
    jade = w.material("jade", (0.12, 0.4, 0.22), roughness=0.3)
    w.animation("carousel", *add_carousel(w, metal, paints, (3.2, 0, -0.4)))
    w.animation("tentacle", *add_tentacle(w, skin, (-3.7, 0.2, 0)))
    w.animation("morph", *add_morph(w, jade, (0.0, 0.95, -1.6)))
    plinth = box((-0.35, 0, -0.35), (0.35, 0.35, 0.35))
    w.node("plinth", translation=[0, 0, -1.6], mesh=w.mesh("plinth", w.primitive(plinth, metal)))
    w.animation("ball", *add_ball(w, paints[0]))
    w.animation("lights", *add_lights(w))
    w.animation("walk", *add_camera(w))
    w.gltf.asset.extras = {"taubench_gl": {"environment": SKY}}
    return w
