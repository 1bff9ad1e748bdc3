"""assets/stand-ins (``tools/record assets``): what ``taubench_gl.datasets.stand_ins`` describes."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import figures
import numpy as np
import valley
from shapes import box, sphere

from taubench_gl.datasets.camera_path import FPS, VR, CameraPath, CameraSpec, add_rig, generate, quat_about
from taubench_gl.datasets.gltf_writer import Writer

log = logging.getLogger(__name__)
Array = np.ndarray
Tracks = list[tuple]

LICENSE = "CC0-1.0, made for taubench-gl"


@dataclass(frozen=True, slots=True)
class StandIn:
    """Parameters of one stand-in.

    Dynamic point lights are ``shots`` + ``flashes`` + ``carried``; dynamic rigid objects ``shots`` + ``carried`` +
    ``birds`` + ``debris``.
    """

    name: str
    stands_for: str
    camera: CameraSpec
    armatures: int
    lanterns: int
    shots: int
    flashes: int
    carried: int
    birds: int
    debris: int
    yfov: float  # degrees
    reach: float  # meters along the valley that the camera and the events cover
    albedo: float  # factor on all colors: with it, indirect light has about the paper's column at 1920x1080
    exposure: float  # recorded in the file: with it, direct light has about the paper's column
    seed: int

    @property
    def note(self) -> str:
        return (
            f"procedural stand-in for {self.stands_for}, not the dataset; its camera has the paper's Table 2 and 3 "
            f"rows, within 5 %, at {self.camera.fps:g} fps"
        )


RECIPES = {
    s.name: s
    for s in (
        StandIn(
            "eternal-valley-fps", "EternalValleyFPS", FPS, 32, 73, 360, 200, 57, 30, 30, 60.0, 132.0, 0.82, 1.04, 11
        ),
        StandIn("eternal-valley-vr", "EternalValleyVR", VR, 34, 63, 370, 190, 66, 25, 30, 75.0, 34.0, 0.65, 1.02, 12),
    )
}


def build(recipe: StandIn) -> Writer:
    """The stand-in of ``recipe`` as a glTF file that is not yet saved."""
    w, rng, path = _begin(recipe)
    seconds = float(path.times[-1])
    events = _Events(recipe, path, rng)
    places = [events.place() for _ in range(recipe.armatures)]
    w.animation("figures", *figures.add_figures(w, rng, places, seconds, recipe.albedo))
    w.animation("shots", *add_shots(w, rng, recipe, events, seconds))
    w.animation("flashes", *add_flashes(w, rng, recipe, events))
    w.animation("carried lights", *add_carried(w, rng, recipe, events, seconds))
    w.animation("birds", *add_birds(w, rng, recipe, seconds))
    w.animation("debris", *add_debris(w, rng, recipe, events, seconds))
    w.animation("camera", *add_camera(w, recipe, path))
    return w


def camera_path(recipe: StandIn) -> CameraPath:
    """The camera path of ``build(recipe)``."""
    return _begin(recipe)[2]


def _begin(recipe: StandIn) -> tuple[Writer, np.random.Generator, CameraPath]:
    """The static part of the scene, and the camera path."""
    w = Writer(LICENSE, "taubench-gl scenes make", share=True)
    name = f"{recipe.name} (stand-in)"
    file_notes = {"stand_in": recipe.note, "name": name, "exposure": f"{recipe.exposure:g}"}
    w.gltf.asset.extras = {"taubench_gl": file_notes}
    w.gltf.scenes[0].name = name
    rng = np.random.default_rng(recipe.seed)
    x = -100.0 if recipe.reach > 100 else 10.0
    begin = (x, float(valley.middle(x)) + 12.0)
    obstacles = valley.build_valley(w, rng, begin, recipe.albedo)
    valley.add_lanterns(w, rng, recipe.lanterns, obstacles, recipe.albedo)
    return w, rng, generate(recipe.camera, valley.ValleySpace(obstacles, begin, -90.0, recipe.reach))


class _Events:
    """Chooses times and positions of events near the camera, so that they are visible."""

    def __init__(self, recipe: StandIn, path: CameraPath, rng: np.random.Generator):
        self._path, self._rng, self.frames = path, rng, recipe.camera.frames
        self._spread = 45.0 if recipe.reach > 100 else 22.0

    def frame(self) -> int:
        return int(self._rng.integers(0, self.frames))

    def place(self, frame: int | None = None) -> tuple[float, float]:
        """(x, z) on the valley floor, some meters from the camera in ``frame`` (None: a random frame)."""
        eye = self._path.position[self.frame() if frame is None else frame]
        while True:
            x, z = eye[[0, 2]] + self._rng.normal(0.0, self._spread, 2)
            if valley.on_floor(x, z) and math.hypot(x - eye[0], z - eye[2]) > 4.0:
                return float(x), float(z)


def _switched(birth: int, death: int, fps: float) -> tuple[list[float], Array]:
    """STEP keys of a scale that is 1 in frames birth .. death - 1 and 0 in all other frames.

    The keys lie between frames, because the time of a frame rounded to float32 may be before or after the frame.
    """
    keys = [(0.0, float(birth <= 0))]
    if birth > 0:
        keys.append(((birth - 0.5) / fps, 1.0))
    keys.append(((death - 0.5) / fps, 0.0))
    return [t for t, _ in keys], np.repeat([[s] for _, s in keys], 3, axis=1)


def add_shots(w: Writer, rng: np.random.Generator, recipe: StandIn, events: _Events, seconds: float) -> Tracks:
    """Projectiles: a ball and its light that appear, fly and disappear."""
    fps, tracks = recipe.camera.fps, []
    kinds = []
    for name, color in (("fire", (1.0, 0.45, 0.15)), ("frost", (0.35, 0.65, 1.0)), ("venom", (0.45, 1.0, 0.3))):
        light = w.light(type="point", name=name, color=list(color), intensity=48.0, range=12.0)
        kinds.append((w.mesh(name, w.primitive(sphere(0.14, 6, 9), valley.glowing(w, name, color))), light))
    for i in range(recipe.shots):
        mesh, light = kinds[i % len(kinds)]
        life = int(rng.integers(24, 72))
        birth = int(rng.integers(1 - life // 2, events.frames - life))
        death = birth + life
        x, z = events.place(int(np.clip(birth + life // 2, 0, events.frames - 1)))
        turn, speed = rng.uniform(0, 2 * math.pi), rng.uniform(14.0, 34.0)
        t = np.linspace(max(birth, 0), death, 6) / fps
        out = speed * (t - 0.5 * (birth + death) / fps)
        px, pz = x + out * math.cos(turn), z + out * math.sin(turn)
        arc = 1.0 - ((t - t[0]) / (t[-1] - t[0]) * 2 - 1) ** 2
        path = np.stack([px, valley.height(px, pz) + 1.3 + 0.8 * arc, pz], axis=-1)
        node = w.node(f"shot {i}", mesh=mesh, translation=path[0].tolist(), scale=[float(birth <= 0)] * 3)
        w.node("light", node, translation=[0.0, 0.3, 0.0], extensions=light)
        times, states = _switched(birth, death, fps)
        tracks += [(node, "translation", t, path, "LINEAR"), (node, "scale", times, states, "STEP")]
    return tracks


def add_flashes(w: Writer, rng: np.random.Generator, recipe: StandIn, events: _Events) -> Tracks:
    """Muzzle flashes and impacts: static lights that exist for a few frames."""
    light = w.light(type="point", name="flash", color=[1.0, 0.82, 0.55], intensity=120.0, range=16.0)
    tracks = []
    for i in range(recipe.flashes):
        birth = int(rng.integers(1, events.frames - 12))
        x, z = events.place(birth)
        at = [x, float(valley.height(x, z)) + 1.4, z]
        node = w.node(f"flash {i}", translation=at, scale=[0.0] * 3, extensions=light)
        times, states = _switched(birth, birth + int(rng.integers(3, 9)), recipe.camera.fps)
        tracks.append((node, "scale", times, states, "STEP"))
    return tracks


def add_carried(w: Writer, rng: np.random.Generator, recipe: StandIn, events: _Events, seconds: float) -> Tracks:
    """Floating lights that exist all the time."""
    color = (0.9, 0.85, 0.6)
    light = w.light(type="point", name="wisp", color=list(color), intensity=12.0, range=9.0)
    mesh = w.mesh("wisp", w.primitive(sphere(0.1, 6, 9), valley.glowing(w, "wisp", color)))
    tracks = []
    for i in range(recipe.carried):
        x, z = events.place()
        t = np.linspace(0.0, seconds, 31)
        phase = 2 * math.pi * (rng.uniform(0.5, 1.5) * t / seconds + rng.uniform(0, 1))
        px, pz = x + 3 * np.cos(phase), z + 3 * np.sin(phase)
        path = np.stack([px, valley.height(px, pz) + 1.6 + 0.4 * np.sin(3 * phase), pz], axis=-1)
        node = w.node(f"wisp {i}", mesh=mesh, translation=path[0].tolist())
        w.node("light", node, translation=[0.0, -0.2, 0.0], extensions=light)
        tracks.append((node, "translation", t, path, "LINEAR"))
    return tracks


def add_birds(w: Writer, rng: np.random.Generator, recipe: StandIn, seconds: float) -> Tracks:
    wings = box((-0.9, 0.0, -0.18), (0.9, 0.05, 0.18))
    mesh = w.mesh("bird", w.primitive(wings, w.material("bird", (0.05, 0.05, 0.06))))
    tracks = []
    for i in range(recipe.birds):
        t = np.linspace(0.0, seconds, 31)
        turn = 2 * math.pi * rng.uniform() + rng.choice([-1, 1]) * t * rng.uniform(0.3, 0.6)
        radius, center = rng.uniform(12, 30), rng.uniform([-110, -15], [110, 15])
        path = np.stack([center[0] + radius * np.cos(turn), np.full_like(t, rng.uniform(9, 22)),
                         center[1] + radius * np.sin(turn)], axis=-1)  # fmt: skip
        node = w.node(f"bird {i}", mesh=mesh, translation=path[0].tolist())
        tracks += [(node, "translation", t, path, "LINEAR")]
        tracks += [(node, "rotation", t, quat_about("y", -np.degrees(turn) - 90), "LINEAR")]
    return tracks


def add_debris(w: Writer, rng: np.random.Generator, recipe: StandIn, events: _Events, seconds: float) -> Tracks:
    """Stones that are repeatedly thrown up, rotate and fall."""
    shape = valley.rock(7)
    shape = {**shape, "POSITION": shape["POSITION"] * 0.28}
    mesh = w.mesh("stone", w.primitive(shape, w.material("stone", (recipe.albedo,) * 3, roughness=0.9)))
    tracks = []
    for i in range(recipe.debris):
        x, z = events.place()
        t = np.linspace(0.0, seconds, 61)
        flight = np.mod(t * rng.uniform(0.6, 1.0) + rng.uniform(), 1.0)
        up = valley.height(x, z) + 0.2 + 9 * flight * (1 - flight)
        path = np.stack([x + 2 * flight, up, z - 2 * flight], axis=-1)
        node = w.node(f"stone {i}", mesh=mesh, translation=path[0].tolist())
        tracks.append((node, "translation", t, path, "LINEAR"))
        tracks.append((node, "rotation", t, quat_about("x", 400.0 * t + 40 * i), "LINEAR"))
    return tracks


def add_camera(w: Writer, recipe: StandIn, path: CameraPath) -> Tracks:
    return add_rig(
        path,
        lambda name, parent, **properties: w.node(name, parent, **properties),
        w.camera("stand-in camera", math.radians(recipe.yfov), 0.1, 1000.0),
        "stand-in camera",
    )
