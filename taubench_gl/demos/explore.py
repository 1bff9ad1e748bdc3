"""The parameter of a demo in a notebook: a slider with the image and the number at each of its values."""

from __future__ import annotations

import importlib.util
from typing import Any

from taubench_gl.demos.demo import Parameter, value_texts
from taubench_gl.errors import SettingsError
from taubench_gl.outputs import image_bytes


def explore(parameter: Parameter, width: int = 640) -> Any:
    """An ipywidgets box: slider, number with its theory, and image, ``width`` pixels wide.

    Raises SettingsError without ipywidgets.
    """
    if importlib.util.find_spec("ipywidgets") is None:
        raise SettingsError("sliders need ipywidgets", hint="run: pip install 'taubench-gl[notebook]'")
    import ipywidgets

    slider = ipywidgets.SelectionSlider(
        options=list(zip(value_texts(parameter), range(len(parameter.values)))), value=parameter.start,
        description=parameter.name, style={"description_width": "initial"}, layout={"width": f"{width}px"},
    )  # fmt: skip
    reading, image = ipywidgets.HTML(), ipywidgets.Image(format="png", width=width)

    def show(i: int) -> None:
        reading.value = number_text(parameter, i)
        image.value = image_bytes(parameter.picture(i))

    slider.observe(lambda change: show(change["new"]), names="value")
    show(parameter.start)
    return ipywidgets.VBox([slider, reading, image, ipywidgets.HTML(parameter.note)])


def number_text(parameter: Parameter, i: int) -> str:
    """The number at value ``i`` with its theory: ``12.38 % of the pixels are discarded; theory 12.38 ± 1.40``."""
    digits, expected = parameter.digits, parameter.expected[i]
    text = f"{parameter.measured[i]:.{digits}f} {parameter.number_unit}".strip() + f" {parameter.meaning}"
    if expected is None:
        return text
    return f"{text}; theory {expected:.{digits}f} ± {parameter.tolerance[i]:.{digits}f}"
