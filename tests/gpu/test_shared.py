"""Objects that several users of one context share."""

from __future__ import annotations

import pytest

from taubench_gl.gpu.shared import Shared


class Made:
    def __init__(self) -> None:
        self.released = 0

    def release(self) -> None:
        self.released += 1


def test_an_object_is_made_once_and_freed_after_its_last_user():
    shared, scene = Shared(), object()
    first, second = (shared.hold(scene, "trees", Made) for _ in range(2))
    assert first.value is second.value and shared.has(scene, "trees")
    first.release()
    assert not second.value.released
    second.release()
    assert second.value.released == 1 and not shared.has(scene, "trees")
    assert shared.hold(scene, "trees", Made).value is not first.value


def test_objects_differ_by_kind_and_by_the_identity_of_what_they_belong_to():
    shared, equal = Shared(), [(1.5, 2.5), tuple([1.5, 2.5])]
    values = [shared.hold(of, kind, Made).value for of in equal for kind in ("a", "b")]
    assert len(set(map(id, values))) == 4


def test_objects_without_a_user_stay_while_they_are_kept():
    shared, scene = Shared(), object()
    with shared.kept(), shared.kept():
        held = shared.hold(scene, "trees", Made)
        held.release()
        assert not held.value.released
        again = shared.hold(scene, "trees", Made)
        assert again.value is held.value
    assert not held.value.released  # it has a user
    again.release()
    assert held.value.released == 1


def test_what_cannot_be_made_is_not_held():
    shared, scene = Shared(), object()
    with pytest.raises(ZeroDivisionError):
        shared.hold(scene, "trees", lambda: 1 / 0)
    assert not shared.has(scene, "trees")
