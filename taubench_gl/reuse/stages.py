"""The stages of a published method, and which of them a method of this project has.  Plain data, no GL.

A method that names the stages of its paper says of each where it is computed, or why it is missing.  A method with a
missing stage carries that in its name: ``svgf_without_taa``, or ``-class`` at its end: of this class of methods, but
not complete.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
INCOMPLETE = "-class"
"""End of the name of a method that is of a class of methods, and lacks stages that others of it have."""

_KEYS = ("doc", "paper", "shader", "missing")


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage of a paper's pipeline.

    ``doc``: what it computes; ``paper``: section or equation; ``shader``: the file that computes it, None for a method
    in Python; ``missing``: why the method does not have it, None if it does.
    """

    name: str
    doc: str
    paper: str
    shader: str | None = None
    missing: str | None = None

    @property
    def done(self) -> bool:
        return self.missing is None


def parse_stages(raw: object, method: str, shaders: Collection[str] | None) -> tuple[tuple[Stage, ...], list[str]]:
    """Stages from ``{name: {doc, paper, shader or missing}}``, and all errors.

    ``method``: its name; ``shaders``: files of its passes, None for a method in Python.
    """
    if not isinstance(raw, Mapping):
        return (), ["stages: must be a table such as accumulation = { doc = ..., paper = ..., shader = ... }"]
    stages, errors = [], []
    for name, entry in raw.items():
        stage, more = _parse_stage(name, entry, shaders)
        errors += [f"stages.{name}{error}" for error in more]
        if stage is None:
            continue
        stages.append(stage)
        named = method.endswith(INCOMPLETE) or ("without" in method and name in method)
        if not stage.done and not named:
            names = f"{method}_without_{name}, or {method}{INCOMPLETE}"
            errors.append(f"stages.{name}: a missing stage is in the method's name: {names}")
    return tuple(stages), errors


def _parse_stage(name: object, entry: object, shaders: Collection[str] | None) -> tuple[Stage | None, list[str]]:
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        return None, [": is not a name: lower-case letters, digits, single _"]
    if not isinstance(entry, Mapping):
        return None, [": must be a table with doc, paper, and shader or missing"]
    errors = [f".{key}: unknown key (allowed: {', '.join(_KEYS)})" for key in entry if key not in _KEYS]
    texts = {key: entry.get(key) for key in _KEYS}
    for key, value in texts.items():
        required = key in ("doc", "paper")
        if (value is None and required) or (value is not None and (not isinstance(value, str) or not value.strip())):
            errors.append(f".{key}: {value!r} is not text")
    shader, missing = texts["shader"], texts["missing"]
    if shaders is None and shader is not None:
        errors.append(".shader: a method in Python has none")
    if shaders is not None and missing is None and shader not in shaders:
        errors.append(f".shader: {shader!r} is not a file of its passes (available: {', '.join(sorted(shaders))})")
    if missing is not None and shader is not None:
        errors.append(": has both shader and missing")
    return (None, errors) if errors else (Stage(name, texts["doc"], texts["paper"], shader, missing), [])
