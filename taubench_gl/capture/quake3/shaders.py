"""Shader scripts of the game, as far as geometry, image, alpha, sides and light need them.

A shader is a name, keywords, and stages of keywords in braces.  Keywords are read as the engine and its map compiler
(q3map) read them; unknown ones are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from taubench_gl.capture.quake3.paks import Paks

MAX_SCRIPT = 4 << 20
_CUTOFF = {"gt0": 0.01, "ge128": 0.5, "lt128": 0.5}
_IMAGE_KEYWORDS = {"map": 1, "clampmap": 1, "animmap": 2}  # keyword -> place of the first image among its words
_NUMBER = re.compile(r"[-+]?(?:\d{1,30}\.?\d{0,30}|\.\d{1,30})(?:e[-+]?\d{1,2})?")


@dataclass
class Look:
    """How a surface looks, as far as glTF can say it."""

    images: tuple[str, ...]  # names to try in order
    alpha: str = "OPAQUE"
    cutoff: float = 0.5
    double_sided: bool = False
    drawn: bool = True
    sky: bool = False
    left_out: str = ""  # why the surface is not in the file
    animated: bool = False  # its image scrolls, turns or changes, which is not in the file
    suns: tuple[tuple[float, ...], ...] = ()  # red, green, blue, intensity, yaw and elevation in degrees
    surface_light: float = 0.0  # q3map's value
    light_image: str | None = None


def number(text: str) -> float:
    """The number that a text begins with, else 0, as C's atof: scripts have words where numbers belong."""
    match = _NUMBER.match(text)
    return float(match[0]) if match else 0.0


def read_scripts(paks: Paks) -> dict[str, list[list[list[str]]]]:
    """Shader name -> keywords of the shader, then of each stage.  The first script by name wins, as in the engine."""
    out: dict[str, list[list[list[str]]]] = {}
    for name in paks.names("scripts/", ".shader"):
        for shader, parts in parse_script((paks.read(name) or b"")[:MAX_SCRIPT].decode("latin-1")):
            out.setdefault(shader, parts)
    return out


def parse_script(text: str) -> Iterator[tuple[str, list[list[list[str]]]]]:
    """(name, [keywords, of the stages too]) of each shader; what is unbalanced at the end is left out."""
    first, *others = text.split("/*")
    text = first + " ".join(part.partition("*/")[2] for part in others)
    name, depth, parts = "", 0, []
    for line in text.splitlines():
        for piece in re.split(r"([{}])", line.partition("//")[0]):
            words = piece.split()
            if not words:
                continue
            if piece == "{":
                depth += 1
                if depth <= 2:
                    parts = [[]] if depth == 1 else [*parts, []]
            elif piece == "}":
                if depth == 1 and name:
                    yield name, parts
                    name = ""
                depth = max(depth - 1, 0)
            elif depth == 0:
                name = words[0].strip('"').lower().replace("\\", "/")
            elif depth <= 2:
                parts[0 if depth == 1 else -1].append([word.lower() for word in words])


def describe(name: str, parts: list[list[list[str]]] | None) -> Look:
    """The look of a shader; without a script its name is its image."""
    look = Look((name,))
    if parts is None:
        return look
    editor = []
    for keyword, *words in parts[0]:
        first = words[0] if words else ""
        if keyword == "cull":
            look.double_sided = first in ("none", "disable", "twosided")
        elif keyword == "surfaceparm":
            look.sky |= first == "sky"
            look.drawn &= first != "nodraw"
            look.left_out = "fog volumes" if first == "fog" else look.left_out
        elif keyword == "skyparms":
            look.sky = True
        elif keyword in ("q3map_sun", "sun", "q3map_sunext") and len(words) >= 6:
            look.suns += (tuple(number(word) for word in words[:6]),)
        elif keyword == "q3map_surfacelight":
            look.surface_light = max(number(first), 0.0)
        elif keyword == "q3map_lightimage":
            look.light_image = first
        elif keyword == "qer_editorimage":
            editor = [first]
        elif keyword == "deformvertexes" and first.startswith("autosprite"):
            look.left_out = "sprites"
    images = _read_stages(look, parts[1:])
    look.images = tuple(dict.fromkeys((*images, *editor, name)))
    if not look.drawn:
        look.left_out = ""
    return look


def _read_stages(look: Look, stages: list[list[list[str]]]) -> list[str]:
    """Set what the stages say; their images, that of the first lit or painted stage first."""
    images, reflections = [], []
    for stage in stages:
        keywords = {keyword: words for keyword, *words in stage}
        image = next((w[i - 1] for k, i in _IMAGE_KEYWORDS.items() if len(w := keywords.get(k, ())) >= i), "")
        look.animated |= "tcmod" in keywords or "animmap" in keywords
        if not image or image.startswith(("$", "*")):
            continue
        if keywords.get("tcgen", [""])[:1] == ["environment"]:
            reflections.append(image)
            continue
        if not images:
            _set_alpha(look, keywords.get("alphafunc", []), keywords.get("blendfunc", []))
        images.append(image)
    return images + reflections


def _set_alpha(look: Look, test: list[str], blend: list[str]) -> None:
    if test:
        look.alpha, look.cutoff = "MASK", _CUTOFF.get(test[0], 0.5)
    elif blend and blend[-1] in ("add", "gl_one"):
        look.left_out = look.left_out or "additive surfaces"
    elif blend in (["blend"], ["gl_src_alpha", "gl_one_minus_src_alpha"]):
        look.alpha = "BLEND"
