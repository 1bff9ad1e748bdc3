"""The masks in PyTorch: camera reprojection as tensors, history by grid_sample.  Runs in any Python with torch."""

from __future__ import annotations

import time

from serve import serve


def prepare():
    import numpy as np
    import torch

    def tensors(request: dict) -> tuple:
        pair = request["pair"]
        images = {f"{w}_{n}": torch.from_numpy(np.array(v)) for w in ("current", "history")
                  for n, v in request[w].items()}  # fmt: skip
        numbers = {k: torch.tensor(np.asarray(v), dtype=torch.float32) for k, v in pair.items()}
        # History planes in the layout of grid_sample; this conversion is not timed.
        both = torch.cat([images["history_position"], images["history_normal"]], dim=-1)
        return images, numbers, both.permute(2, 0, 1)[None].contiguous(), request["thresholds"], request["bits"]

    @torch.no_grad()
    def masks(images, n, planes, thresholds, bits):
        position, normal = images["current_position"], images["current_normal"]
        h, w = position.shape[:2]
        surface = position[..., 3] > 0
        y, x = torch.meshgrid(torch.arange(h - 1, -1, -1.0), torch.arange(float(w)), indexing="ij")
        sky = n["sky_origin"] + x[..., None] * n["sky_dx"] + y[..., None] * n["sky_dy"]
        p = torch.where(surface[..., None], torch.cat([position[..., :3], torch.ones(h, w, 1)], -1), sky)
        q = torch.cat([p[..., :3] + p[..., 3:] * n["camera_delta"], p[..., 3:]], -1)
        slack = (n["near"] - position[..., 3]).clamp(min=0.0)
        limit = torch.where(surface, n["prev_near"] * (1 - 1e-5) - slack, torch.zeros(()))
        behind = q[..., :3] @ n["prev_forward"] <= limit
        now, then = p @ n["clip_from_current"].T, q @ n["prev_clip_from_prev"].T
        motion = (then[..., :2] / then[..., 3:] - now[..., :2] / now[..., 3:]) * 0.5 * torch.tensor([w, h])
        at_x, at_y = x + motion[..., 0], y + motion[..., 1]
        guard = 1 / 256
        outside = (at_x < -guard) | (at_y < -guard) | (at_x > w - 1 + guard) | (at_y > h - 1 + guard)
        grid = torch.stack([at_x * 2 / (w - 1) - 1, (h - 1 - at_y) * 2 / (h - 1) - 1], -1)[None]
        taken = torch.nn.functional.grid_sample(planes, grid, "nearest", "border", align_corners=True)[0]
        taken = taken.permute(1, 2, 0)
        before = taken[..., 3] > 0
        both, differ = surface & before, surface != before
        moved = (q[..., :3] - taken[..., :3]).norm(dim=-1)
        turned = (normal[..., :3] - taken[..., 4:7]).norm(dim=-1)
        nearer = q[..., :3].norm(dim=-1) - taken[..., :3].norm(dim=-1)
        far = both & (moved > thresholds["position"])
        word = torch.zeros(h, w, dtype=torch.int64)

        def mark(where, name):
            return where.to(torch.int64) * bits[name]

        alive = ~(behind | outside)
        word += mark(~surface, "SKY") + mark(behind, "BEHIND") + mark(outside & ~behind, "OUTSIDE")
        word += mark(alive & ~before, "HISTORY_SKY") + mark(alive & (far | differ), "POSITION")
        word += mark(alive & ((both & (turned > thresholds["normal"])) | differ), "NORMAL")
        hidden = (far & (nearer > thresholds["position"])) | (differ & before)
        covers = (far & (-nearer > thresholds["position"])) | (differ & surface)
        word += mark(alive & hidden, "DISOCCLUDED") + mark(alive & covers, "OCCLUDING")
        return torch.bincount(word.reshape(-1), minlength=1 << 16)

    def answer(request: dict) -> dict:
        given = tensors(request)
        start = time.perf_counter()
        mask_histogram = masks(*given)
        return {"ms": (time.perf_counter() - start) * 1e3, "mask_histogram": mask_histogram.numpy()}

    return answer, {"version": str(torch.__version__)}


serve(prepare)
