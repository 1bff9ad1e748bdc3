"""Places of distances in the textures that the masks write."""

from __future__ import annotations

import pytest

from taubench_gl.features import FEATURES
from taubench_gl.frame.passes.masks import PLACES, _places


def test_every_feature_has_a_place_of_its_own_and_a_seventh_is_an_error():
    assert set(PLACES) == set(FEATURES) and len(set(PLACES.values())) == len(FEATURES)
    assert len(_places([*"abcdef"])) == 6
    with pytest.raises(IndexError):
        _places([*"abcdefg"])
