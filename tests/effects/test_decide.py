"""Effects that a scene calls for, decided before anything is drawn."""

from __future__ import annotations

from itertools import product

import pytest
from fixed import fixed_settings

from taubench_gl.effects.decide import decide
from taubench_gl.scene.builder import SceneBuilder, box


@pytest.mark.parametrize(("masked", "blended", "opaque"), product(range(2), range(2), range(2)))
def test_alpha_is_evaluated_where_a_drawn_material_cuts_or_blends(masked, blended, opaque):
    b = SceneBuilder()
    for mode, count in (("MASK", masked), ("BLEND", blended), ("OPAQUE", opaque)):
        material = b.material(alpha_mode=mode)  # one that nothing draws calls for nothing
        for _ in range(count):
            b.node(mesh=b.mesh(box(material=material)))
    assert decide(b.build(), fixed_settings())["alpha_mask"].enabled == bool(masked or blended)
