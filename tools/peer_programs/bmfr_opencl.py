"""The OpenCL kernels of BMFR's authors, driven frame by frame.  Runs in any Python with NumPy and pyopencl.

Arguments: the folder with their ``bmfr.cl`` and ``bmfr.cpp``, width, height, and a JSON object: ``defines``, values
that replace those of ``bmfr.cpp``; ``limits``, squares of the limits of position and normal; ``replace``, [pattern,
text] pairs applied to ``bmfr.cl`` before it is compiled; ``copy``: the accumulation gets its input in a buffer of its
own, after its argument ``current_noisy``.  Kernels and constants are read from the folder; nothing of it is kept here.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

from serve import serve

LITERALS = (
    "NOISE_AMOUNT", "BLEND_ALPHA", "SECOND_BLEND_ALPHA", "TAA_BLEND_ALPHA", "COMPRESSED_R", "CACHE_TMP_DATA",
    "ADD_REQD_WG_SIZE", "USE_HALF_PRECISION_IN_TMP_DATA", "LOCAL_WIDTH", "LOCAL_HEIGHT", "BLOCK_EDGE_LENGTH",
    "LOCAL_SIZE",
)  # fmt: skip
"""Constants that their host program hands to the compiler of the kernels as they are."""
COLORS = 3


def read_defines(text: str) -> dict[str, str]:
    """Name -> text of each ``#define`` of a C++ file; lines that a backslash continues are one."""
    joined = re.sub(r"\\\n", " ", text)
    return {
        name: value.split("//")[0].strip() for name, value in re.findall(r"^#define (\w+)[ \t]+(.+)$", joined, re.M)
    }


def strings(text: str) -> str:
    """The string literals of a C++ expression, joined."""
    return "".join(re.findall(r'"([^"]*)"', text))


class Layout:
    """Numbers that follow from the size of the image and from their constants."""

    def __init__(self, defines: dict[str, str], width: int, height: int):
        self.plain = strings(defines["NOT_SCALED_FEATURE_BUFFERS"])
        self.scaled = strings(defines["SCALED_FEATURE_BUFFERS"])
        self.features = self.plain.count(",") + self.scaled.count(",") + 1
        self.buffers = self.features + COLORS
        self.edge = int(defines["BLOCK_EDGE_LENGTH"])
        self.work = [self.edge * -(-side // self.edge) for side in (width, height)]
        self.wide = [side + self.edge for side in self.work]
        self.blocks = self.wide[0] * self.wide[1] // self.edge**2

    def options(self, defines: dict[str, str], limits: list[float], width: int, height: int) -> list[str]:
        """Options of the OpenCL compiler."""
        computed = {
            "BUFFER_COUNT": self.buffers, "R_EDGE": self.buffers - 2, "BLOCK_PIXELS": self.edge**2,
            "FEATURES_NOT_SCALED": self.plain.count(","), "FEATURES_SCALED": self.scaled.count(",") + 1,
            "FEATURE_BUFFERS": self.plain + self.scaled, "IMAGE_WIDTH": width, "IMAGE_HEIGHT": height,
            "WORKSET_WIDTH": self.work[0], "WORKSET_HEIGHT": self.work[1], "WORKSET_WITH_MARGINS_WIDTH": self.wide[0],
            "WORKSET_WITH_MARGINS_HEIGHT": self.wide[1], "POSITION_LIMIT_SQUARED": limits[0],
            "NORMAL_LIMIT_SQUARED": limits[1],
        }  # fmt: skip
        return [f"-D{name}={value}" for name, value in ({n: defines[n] for n in LITERALS} | computed).items()]


def prepare():
    import numpy as np
    import pyopencl as cl

    folder, width, height, request = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), json.loads(sys.argv[4])
    defines = read_defines((folder / "bmfr.cpp").read_text()) | request["defines"]
    layout = Layout(defines, width, height)
    if any(work + layout.edge > 2 * side for work, side in zip(layout.work, (width, height), strict=True)):
        raise ValueError(f"{width}x{height}: their mirrored pixels would lie outside an image so small")
    source = (folder / "bmfr.cl").read_text()
    for pattern, text in request["replace"]:
        source, count = re.subn(pattern, text, source)
        if count == 0:
            raise ValueError(f"bmfr.cl has no {pattern}")
    device = cl.get_platforms()[0].get_devices()[0]
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    program = cl.Program(context, source).build(layout.options(defines, request["limits"], width, height))
    kernels = {k.function_name: k for k in program.all_kernels()}
    pixels, half = width * height, int(defines["USE_HALF_PRECISION_IN_TMP_DATA"])

    def buffer(count: int):
        zeros = np.zeros(count, dtype=np.uint8)
        return cl.Buffer(context, cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR, hostbuf=zeros)

    def image():
        return buffer(pixels * 12)

    pairs = {n: [image(), image()] for n in ("normal", "position", "noisy", "filtered", "result")}
    pairs["samples"] = [buffer(pixels), buffer(pixels)]
    at, accepted, albedo, copied, fitted, shown = buffer(pixels * 8), buffer(pixels), image(), image(), image(), image()
    matrix = buffer(layout.wide[0] * layout.wide[1] * layout.buffers * (2 if half else 4))
    weights, ranges = buffer(layout.blocks * layout.features * 12), buffer(layout.blocks * 6 * 8)
    threads = int(defines["LOCAL_SIZE"])
    columns = layout.buffers - 2
    triangle = columns * (columns + 1) // 2 if int(defines["COMPRESSED_R"]) else columns**2
    local = [cl.LocalMemory(n) for n in (4 * threads, 4 * layout.edge**2, 16 * triangle)]
    group = int(defines["LOCAL_WIDTH"]), int(defines["LOCAL_HEIGHT"])
    frame = 0

    def answer(request: dict) -> dict:
        """Images ``noisy normal position albedo`` (h, w, 3), row 0 at the bottom, ``matrix`` (4, 4) from the world to
        the previous clip space, for row vectors, and ``offset`` (2,) -> ``result`` and, before the anti-aliasing,
        ``shown``: display-encoded."""
        nonlocal frame
        now = {name: pair[frame % 2] for name, pair in pairs.items()}
        old = {name: pair[1 - frame % 2] for name, pair in pairs.items()}
        for name, target in (("noisy", now["noisy"]), ("normal", now["normal"]), ("position", now["position"])):
            cl.enqueue_copy(queue, target, np.ascontiguousarray(request[name], dtype=np.float32))
        cl.enqueue_copy(queue, albedo, np.ascontiguousarray(request["albedo"], dtype=np.float32))
        noisy = [now["noisy"]]
        if request_copy:
            cl.enqueue_copy(queue, copied, now["noisy"])
            noisy.append(copied)
        number = np.int32(frame)
        camera = np.float32(request["matrix"]).ravel().view(cl.cltypes.float16)[0]
        offset = np.float32(request["offset"]).view(cl.cltypes.float2)[0]
        kernels["accumulate_noisy_data"](
            queue, layout.wide, group, at, accepted, now["normal"], old["normal"], now["position"], old["position"],
            *noisy, old["noisy"], old["samples"], now["samples"], matrix, camera, offset, number,
        )  # fmt: skip
        kernels["fitter"](queue, (threads * layout.blocks,), (threads,), *local, weights, ranges, matrix, number)
        kernels["weighted_sum"](
            queue, layout.work, group, weights, ranges, fitted, now["normal"], now["position"], now["noisy"], number
        )
        kernels["accumulate_filtered_data"](
            queue, layout.work, group, fitted, at, accepted, albedo, shown, now["samples"], old["filtered"],
            now["filtered"], number,
        )  # fmt: skip
        kernels["taa"](queue, layout.work, group, at, shown, now["result"], old["result"], number)
        out = {"result": now["result"], "shown": shown}
        images = {name: np.empty((height, width, 3), dtype=np.float32) for name in out}
        for name, device_image in out.items():
            cl.enqueue_copy(queue, images[name], device_image)
        queue.finish()
        frame += 1
        return images

    request_copy = request["copy"]
    return answer, {"device": f"{device.platform.version}, {device.name}"}


if __name__ == "__main__":
    serve(prepare)
