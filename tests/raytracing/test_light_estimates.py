"""Light of emissive triangles at one point by three estimators that must agree: points on the emitters, directions of
the BRDF that hit them, and both by multiple importance sampling.

Whatever is wrong in a density, an area, an emission or a BRDF shows as a difference.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hit_tools import HEAD, opened

from taubench_gl.animation import choose_camera
from taubench_gl.scene.builder import SceneBuilder, box, quad, skinned, sphere, turn
from taubench_gl.scene.model import Image, Sampler, Texture

ESTIMATES = (
    HEAD
    + """
uniform vec4 material; // base color, metallic, roughness, specular
uniform vec3 point;    // camera-relative

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec4 a = rows[2u * i], b = rows[2u * i + 1u];
    float alpha = max(material.z * material.z, 0.001);
    vec3 up = vec3(0.0, 1.0, 0.0), view = normalize(vec3(0.6, 0.5, 0.2));
    Surface s = Surface(vec3(material.x), material.y, alpha, material.w, up, view);
    float by_light = 0.0, by_brdf = 0.0, both = 0.0;

    int row = emitter_chosen(a.x);
    EmitterSample e = emitter_point(row, a.yz);
    vec3 towards = e.position - point;
    float d2 = dot(towards, towards);
    vec3 l = towards * inversesqrt(d2);
    float cosine = abs(dot(e.normal, l));
    Ray shadow = Ray(point, l, sqrt(d2) * 0.9999);
    if (e.pdf_area > 0.0 && cosine > 0.0 && !occluded(shadow)) {
        Lobes f = evaluate_brdf(s, l);
        float pdf = emitter_probability(row) * e.pdf_area * d2 / cosine, other = brdf_pdf(s, l);
        by_light = (f.diffuse + f.glossy).g * e.radiance.g / pdf;
        both += by_light * pdf * pdf / (pdf * pdf + other * other);
    }
    BrdfSample next = sample_brdf(s, b.xyz);
    Ray ray = Ray(point, next.l, 1e30);
    Hit hit = closest_hit(ray);
    if (next.pdf > 0.0 && hit.instance >= 0) {
        HitSurface x = surface_at(ray, hit, a.w);
        Lobes f = evaluate_brdf(s, next.l);
        by_brdf = (f.diffuse + f.glossy).g * x.emission.g / next.pdf;
        float density = x.emitter < 0 ? 0.0 : emitter_probability(x.emitter) / x.area;
        float other = density * hit.t * hit.t / abs(dot(x.geometric_normal, next.l));
        both += by_brdf * next.pdf * next.pdf / (next.pdf * next.pdf + other * other);
    }
    results[i] = vec4(by_light, by_brdf, both, 0.0);
}
"""
)


def lamps() -> SceneBuilder:
    """Around the origin: a textured one of uneven scale, a mirrored one behind a blocker, a skinned one."""
    b = SceneBuilder()
    b.camera(translation=(3.0, 2.5, 1.0), rotation=turn((0, 1, 0), 60.0), znear=0.01)
    picture = Texture(0, Sampler(wrap_s=33648), uv_transform=np.array([[1.5, 0.2, 0.1], [0.0, 2.0, 0.3]]))
    shown = b.material(emissive=(1.0, 2.0, 1.0), emissive_strength=2.0, emissive_texture=picture)
    plain = b.material(emissive=(3.0, 6.0, 1.0), emissive_strength=2.0)
    dark = b.material(base_color=(0.5, 0.5, 0.5, 1.0))
    sheet = quad(0.5, 0.5, cells=(5, 4), material=shown)
    uv = np.float32(sheet.positions[:, :2] + 0.5)
    b.node(mesh=b.mesh(replace(sheet, texcoords=(uv, None))), translation=(-1.0, 1.0, 0.0), scale=(1.0, 3.0, 1.0),
           rotation=turn((0, 1, 0), 70.0))  # fmt: skip
    b.node(mesh=b.mesh(replace(sphere(0.15, 8), material=plain)), translation=(0.4, 0.8, 0.6), scale=(-1.0, 0.6, 1.0))
    b.node(mesh=b.mesh(box((0.1, 0.1, 0.1), material=dark)), translation=(0.2, 0.45, 0.2))
    joint = b.node(translation=(0.5, 1.5, -0.8), rotation=turn((1, 0, 0), 80.0))
    strip = quad(0.4, 0.1, material=plain)
    b.node(mesh=b.mesh(skinned(strip, np.zeros((4, 4)), np.tile([1.0, 0, 0, 0], (4, 1)))), skin=b.skin([joint]))
    return b


@pytest.mark.parametrize(
    "material", [(0.8, 0.0, 1.0, 0.0), (0.8, 0.0, 0.4, 1.0), (0.9, 1.0, 0.25, 1.0)], ids=["lambert", "glossy", "metal"]
)
def test_three_estimators_agree(gpu, material) -> None:
    """At five standard errors of their differences; both together vary less than the worse one alone."""
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.linspace(0, 3, 16), np.linspace(0, 2, 16))
    pixels = np.stack([127 + 120 * np.sin(2 * x), 127 + 120 * np.cos(3 * x + y), 90 + 0 * x, 255 + 0 * x], axis=-1)
    scene = replace(lamps().build(), images=(Image("lamp", (16, 16), lambda: pixels.astype(np.uint8)),))
    count = 60_000
    rows = np.floor(rng.random((count, 2, 4)) * 2**24) / 2**24
    with opened(gpu, scene, choose_camera(scene), (16, 9), traced=True) as hits:
        hits.at(0.0)
        uniforms = {"material": material, "point": tuple(-hits.renderer.view(0.0)[1].position)}
        includes = "common/brdf_sampling.glsl raytracing/trace.glsl raytracing/emitters.glsl"
        values = hits.run(includes, ESTIMATES, rows, 1, **uniforms)[:, 0, :3]
    mean, error = values.mean(axis=0), values.std(axis=0) / np.sqrt(count)
    assert np.isfinite(values).all() and mean.min() > 0.01
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert abs(mean[a] - mean[b]) < 5.0 * np.hypot(error[a], error[b]) + 2e-3 * mean[2], (mean, error)
    assert error[2] < 1.2 * max(error[:2])
