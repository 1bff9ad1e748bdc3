"""Open Image Denoise on every frame alone: the yardstick of a trained spatial filter without any reuse."""

import numpy as np

from taubench_gl.errors import MethodError


class OpenImageDenoise:
    """The ``RT`` filter in HDR mode.  Base color and normal have no noise here, so they are given as clean auxiliaries.

    Departs: sky has base color and normal 0, where the library's guide suggests albedo 1.
    """

    name = "oidn"
    title = "Open Image Denoise, each frame alone"
    cite = (
        "Afra 2019 to 2025, Intel Open Image Denoise, openimagedenoise.org: filter RT",
        "Ronneberger, Fischer, Brox 2015, U-Net, MICCAI: the architecture of its network",
    )
    reads = ("radiance", "base_color", "normal")
    stages = {  # noqa: RUF012
        "filter": {"paper": "openimagedenoise.org, filter RT", "doc": "HDR, with clean auxiliary images if given"},
    }
    settings = {  # noqa: RUF012 (the contract of a method)
        "auxiliary": {
            "default": "base_color_normal",
            "choices": ["none", "base_color", "base_color_normal"],
            "doc": "what the filter gets beside the radiance",
        },
        "quality": {"default": "high", "choices": ["high", "balanced", "fast"], "doc": "of the library"},
    }

    def __init__(self, size, settings):
        try:
            import pyoidn
        except (ImportError, OSError) as error:  # OSError: a shared library that does not load
            raise MethodError(
                f"Open Image Denoise cannot be loaded: {error}",
                where="method 'oidn'",
                hint="pip install 'taubench-gl[oidn]' (Linux x86-64, Windows, macOS)",
            ) from None
        self._denoise, self._settings = pyoidn.denoise, settings

    def step(self, frame):
        auxiliary, features = self._settings["auxiliary"], {}
        if auxiliary != "none":
            features["albedo"] = np.clip(frame["base_color"][..., :3].astype(np.float32), 0.0, 1.0)
        if auxiliary == "base_color_normal":
            features["normal"] = frame["normal"][..., :3].astype(np.float32)
        image = self._denoise(
            np.ascontiguousarray(frame["radiance"][..., :3]),
            hdr=True,
            clean_aux=bool(features),
            quality=self._settings["quality"],
            **features,
        )
        nothing_kept = np.zeros((*image.shape[:2], 1), dtype=np.float32)
        return np.concatenate([np.maximum(image, 0.0), nothing_kept], axis=2)
