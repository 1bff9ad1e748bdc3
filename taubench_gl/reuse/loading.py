"""Loading methods: built-in ones, entry points ``taubench_gl.methods``, folders, files and classes; and methods with
settings as the command line names them."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import inspect
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import ModuleType

from taubench_gl.data_files import read_bytes
from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.reuse.chain import LINK, chained
from taubench_gl.reuse.contract import Method, Value, suggestion
from taubench_gl.reuse.declaration import BUILTIN, FILE, MAX_METHOD_BYTES, load_folder, method_from_class
from taubench_gl.reuse.recorded import RecordedFrames

__all__ = [
    "BUILTIN", "ENTRY_POINTS", "MethodSpec", "builtin_methods", "installed_methods", "load_method", "method_settings",
    "method_text", "short_name",
]  # fmt: skip

ENTRY_POINTS = "taubench_gl.methods"


@cache
def builtin_methods() -> tuple[str, ...]:
    """Names of the built-in methods, in alphabetical order: folders with method.toml, or with ``NAME/NAME.py``."""
    return tuple(sorted(p.name for p in BUILTIN.iterdir() if (p / FILE).is_file() or (p / f"{p.name}.py").is_file()))


def installed_methods() -> dict[str, str]:
    """Entry points of other packages: name -> ``package.module:attribute``."""
    return {point.name: point.value for point in importlib.metadata.entry_points(group=ENTRY_POINTS)}


def load_method(source: str | Path | type | Method) -> Method:
    """A validated method, without any GL call.

    ``source``: a built-in name, the name of an entry point, a folder with method.toml (or that file), ``file.py`` or
    ``file.py:Class``, ``module:Class``, or the class; ``A>B``: a chain.  Raises MethodError.
    """
    if isinstance(source, Method):
        return source
    if isinstance(source, type):
        return method_from_class(source)
    text = str(source)
    if isinstance(source, str):
        first, link, second = text.rpartition(LINK)
        if link:
            return chained(load_method(first.strip()), load_method(second.strip()))
        if text in builtin_methods():
            return _builtin(text)
        if text in installed_methods():
            return _from_entry_point(text)
    path = Path(text)
    if text and path.is_dir():
        return load_folder(path)
    if path.name == FILE and path.is_file():
        return load_folder(path.parent)
    file, colon, name = text.rpartition(":")
    if path.suffix == ".py" or (colon and file.endswith(".py")):
        return _from_file(path if path.suffix == ".py" else Path(file), name if path.suffix != ".py" else None)
    if colon and file and name.isidentifier():
        return method_from_class(_class_in(_import(file, text), name, text), text)
    names = [*builtin_methods(), *installed_methods()]
    raise MethodError(f"there is no method, folder or file {text!r}{suggestion(text, names)}",
                      hint="a folder needs a method.toml; see 'taubench-gl reuse list'")  # fmt: skip


def _builtin(name: str) -> Method:
    folder = BUILTIN / name
    return load_folder(folder) if (folder / FILE).is_file() else _from_file(folder / f"{name}.py", None)


def _from_entry_point(name: str) -> Method:
    (point,) = [p for p in importlib.metadata.entry_points(group=ENTRY_POINTS) if p.name == name][:1]
    where = f"entry point {name} = {point.value}"
    try:
        loaded = point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # importing another package can raise anything
        raise MethodError(f"cannot be loaded: {type(error).__name__}: {error}", where=where) from error
    if isinstance(loaded, Method):
        return replace(loaded, name=name)
    if isinstance(loaded, type):
        return replace(method_from_class(loaded, where), name=name)
    if isinstance(loaded, (str, Path)) and Path(loaded).is_dir():
        return replace(load_folder(Path(loaded)), name=name)
    raise MethodError("is not a class, a Method or the path of a folder", where=where)


def _import(name: str, where: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # an import runs unknown code, which can raise anything and exit
        raise MethodError(f"module {name} cannot be imported: {type(error).__name__}: {error}", where=where) from error


def _from_file(path: Path, name: str | None) -> Method:
    read_bytes(path, MethodError, max_bytes=MAX_METHOD_BYTES)  # refuses what the loader would read without a limit
    module_name = f"taubench_gl_method_{path.stem}_{abs(hash(str(path.resolve()))):x}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses and pickle look up the module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:  # user code can raise anything and exit
        del sys.modules[module_name]
        if isinstance(error, KeyboardInterrupt):
            raise
        raise MethodError(f"cannot be run: {type(error).__name__}: {error}", where=str(path)) from error
    loaded = _class_in(module, name, str(path))
    method = method_from_class(loaded, f"{path}:{name}" if name else str(path))
    # A file with one method has the name of the file: the class is often called Method.
    return method if name or hasattr(loaded, "name") else replace(method, name=path.stem)


def _class_in(module: ModuleType, name: str | None, where: str) -> type:
    if name is not None:
        loaded = getattr(module, name, None)
        if isinstance(loaded, type):
            return loaded
        names = [n for n, v in vars(module).items() if isinstance(v, type)]
        raise MethodError(f"has no class {name!r}{suggestion(name, names, 'it has no classes')}", where=where)
    classes = [v for v in vars(module).values() if inspect.isclass(v) and v.__module__ == module.__name__]
    classes = [v for v in classes if callable(getattr(v, "step", None))]
    if len(classes) == 1:
        return classes[0]
    names = ", ".join(c.__name__ for c in classes)
    raise MethodError(
        "has no class with a step(self, frame)" if not classes else f"has several methods ({names})",
        where=where,
        hint=None if not classes else f"select one: {where}:{classes[0].__name__}",
    )


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """A method and its settings.  ``label`` identifies it in all outputs."""

    label: str
    method: str | Path | type | Method
    settings: Mapping[str, Value | str] = field(default_factory=dict)  # strings are parsed by the method's settings

    @classmethod
    def parse(cls, text: str) -> MethodSpec:
        """The method of a text ``NAME@setting=value@...``; NAME can be a folder, a file, ``exr:DIR`` or a chain.

        A path is labelled with its class, its file without suffix, or its folder; ``exr:DIR`` with its setting
        ``label``, by default the name of the folder.  Raises SettingsError.
        """
        if LINK in text:
            links = [cls.parse(part) for part in text.split(LINK)]
            settings = {k if "." in k else f"{_method_name(s)}.{k}": v for s in links for k, v in s.settings.items()}
            return cls(LINK.join(s.label for s in links), LINK.join(str(s.method) for s in links), settings)
        name, *parts = text.split("@")
        pairs = [part.partition("=") for part in parts]
        if not name or any(not equals or not key for key, equals, _ in pairs):
            raise SettingsError(f"{text!r} is not a method", hint="give NAME or NAME@setting=value")
        settings = {key.strip(): value for key, _, value in pairs}
        if is_sequence(name):
            return cls(RecordedFrames.label(name, settings.pop("label", None)), name, settings)
        return cls("@".join((short_name(name), *parts)), name, settings)


def _method_name(spec: MethodSpec) -> str:
    """The name of a method, which its settings have before them in a chain."""
    return spec.method if spec.method in builtin_methods() else load_method(spec.method).name


def method_text(name: str, settings: Mapping[str, Value | str]) -> str:
    """The text ``NAME@setting=value@...`` of a method, which ``MethodSpec.parse`` reads."""
    return "@".join((name, *(f"{key}={value}" for key, value in settings.items())))


def short_name(name: str) -> str:
    """What labels of the method ``name`` of the command line begin with: never the name of another, built-in one."""
    file, colon, of_class = name.rpartition(":")
    path = Path(name)
    if path.name == "method.toml":
        path = path.resolve().parent
    short = path.stem if path.suffix == ".py" else path.name
    if colon and file.endswith(".py"):
        short = of_class
    return name if not short or short in builtin_methods() else short


def method_settings(method: Method, changes: Mapping[str, Value | str]) -> dict[str, Value]:
    """Settings of ``method`` with defaults; strings are parsed.  Raises MethodError, also for unknown names."""
    out: dict[str, Value] = {}
    for name, value in changes.items():
        setting = method.settings.get(name)
        text = isinstance(value, str) and setting is not None and setting.kind != "choice"
        try:
            out[name] = setting.parse(value) if text else value
        except MethodError as error:
            raise MethodError(error.what, where=method.label) from None
    return method.values(out)
