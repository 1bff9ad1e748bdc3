"""Maps of Cube 2: cubes, hidden faces, stored polygons, texture slots; and the game's own maps."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from cube2_files import CONFIG, EMPTY, SOLID, cube, hall, map_bytes, slope, write_game
from repeated import few

from taubench_gl.capture.cube2.level import ALPHA, CORNERS, drawn_triangles, read_level
from taubench_gl.capture.cube2.world import Files, Texture, read_textures, texture_coordinates
from taubench_gl.errors import SceneError

VERSIONS = (29, 30, 31, 32, 33)


def level(parts, size, version=33, **rest):
    return read_level(map_bytes(parts, size, version, **rest), "tiny.ogz")


def drawn(parts, size, version=33):
    """Slots, sides, corners and outward normals with the length of the area."""
    slots, sides, corners = drawn_triangles(level(parts, size, version).cubes)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    return slots, sides, corners, areas


def air(n=8):
    return [cube() for _ in range(n)]


@pytest.mark.parametrize("version", VERSIONS)
def test_a_cube_in_the_air_has_six_faces_that_look_outward(version):
    parts = air()
    parts[0] = [*air(7), cube(SOLID, (1, 2, 3, 4, 5, 6))]  # from 4 to 8 along each axis
    slots, sides, corners, areas = drawn(parts, 16, version)
    assert np.array_equal(slots, sides + 1) and len(slots) == 12
    assert corners.min() == 4 and corners.max() == 8
    total = np.zeros((6, 3))
    np.add.at(total, sides, areas)
    normals = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])
    assert np.array_equal(total, 16 * normals)


def test_faces_at_the_border_between_solid_cubes_and_of_the_sky_are_not_drawn():
    parts = air()
    parts[0] = parts[1] = cube(SOLID, (1, 1, 1, 0, 1, 1))
    _, sides, corners, areas = drawn(parts, 16)
    assert sorted(sides.tolist()) == [5, 5, 5, 5]  # the +y faces show the sky, all others are at the border or shared
    assert np.array_equal(areas.sum(0), [0, 0, 128]) and (corners[..., 2] == 8).all()


@pytest.mark.parametrize("hole, seen", [(None, False), (2, True)])
def test_parts_of_a_cube_hide_a_larger_face_together(hole, seen):
    parts = air()
    parts[0] = cube(SOLID)
    parts[1] = [cube(SOLID) if k != hole else cube() for k in range(8)]
    _, sides, corners, _ = drawn(parts, 16)
    own = (sides == 1) & (corners[..., 0] == 8).all(1)
    assert own.any() == seen


def test_see_through_cubes_hide_one_another_only():
    parts = air()
    parts[0], parts[1], parts[2] = cube(SOLID), cube(SOLID, material=ALPHA), cube(SOLID, material=ALPHA)
    parts[3] = cube(SOLID, material=ALPHA)
    _, sides, corners, _ = drawn(parts, 16)
    between = (corners[..., 0] == 8).all(1)
    assert sorted(sides[between].tolist()) == [1, 1]  # of the solid cube against the see-through one; not between two
    assert not ((corners[..., 1] == 8).all(1) & (corners[..., 0] > 8).any(1) & (sides == 3)).any()


def reference_covered(cubes, number, side, triangle, count=9):
    """Whether points inside of a triangle, (3, 3) eighths, all lie on faces of the cubes beyond."""
    dim, out = side >> 1, side & 1
    u, v = (np.arange(count) + 0.37) / count, (np.arange(count) + 0.41) / count
    a, b = (x.ravel() for x in np.meshgrid(u, v))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    points = triangle[0] + a[:, None] * (triangle[1] - triangle[0]) + b[:, None] * (triangle[2] - triangle[0])
    for point in points:
        place = np.floor(point / 8).astype(int)
        place[dim] = triangle[0, dim] // 8 - (0 if out else 1)
        beyond = int(cubes.find(place[None])[0])
        if cubes.empty[beyond]:
            return False
        own = cubes.corners(np.array([beyond]), np.array([side ^ 1]))[0] * cubes.sizes[beyond]
        own = own + 8 * cubes.origins[beyond]
        flat = [corner for corner in own if corner[dim] == triangle[0, dim]]
        across = [axis for axis in range(3) if axis != dim]
        shape = np.array([[corner[axis] for axis in across] for corner in flat], float).reshape(-1, 2)
        way = np.roll(shape, -1, 0) - shape
        to = point[across] - shape
        turns = way[:, 0] * to[:, 1] - way[:, 1] * to[:, 0]
        if len(shape) < 3 or not (way.any() and ((turns >= 0).all() or (turns <= 0).all())):
            return False
    return True


def random_parts(rng, depth):
    out = []
    for _ in range(8):
        kind = rng.integers(0, 5)
        if kind == 0 and depth:
            out.append(random_parts(rng, depth - 1))
        elif kind < 3:
            out.append(cube(SOLID if kind == 1 else EMPTY))
        else:
            ends = rng.choice([0, 4, 8], (12, 2), p=[0.45, 0.1, 0.45])
            low, high = np.minimum(*ends.T), np.maximum(*ends.T)
            out.append(cube(bytes((high << 4 | low).astype(np.uint8).tolist())))
    return out


@pytest.mark.parametrize("seed", few(range(6), 2))
def test_hidden_triangles_are_those_whose_points_all_lie_on_other_cubes(seed):
    rng = np.random.default_rng(seed)
    cubes = level(random_parts(rng, 2), 16).cubes
    _, sides, corners = drawn_triangles(cubes)
    found = {(int(side), *sorted(map(tuple, tri.tolist()))) for side, tri in zip(sides, corners, strict=True)}
    checked = 0
    for number in np.flatnonzero(~cubes.empty).tolist():
        for side in range(6):
            dim, out = side >> 1, side & 1
            corner = cubes.corners(np.array([number]), np.array([side]))[0]
            places = corner * cubes.sizes[number] + 8 * cubes.origins[number]
            inside = (places[:, dim] % (8 * cubes.size) != 0).all()
            first, second = (np.cross(corner[i] - corner[0], corner[i + 1] - corner[0]) for i in (1, 2))
            if not ((corner[:, dim] == 8 * out).all() and inside) or first @ second < 0:  # folded
                continue
            for order in ((0, 1, 2), (0, 2, 3)):
                tri = places[list(order)]
                if not np.cross(tri[1] - tri[0], tri[2] - tri[0]).any():
                    continue
                hidden = reference_covered(cubes, number, side, tri.astype(float))
                key = (side, *sorted(map(tuple, (tri / 8).tolist())))
                other = any(  # divided the other way, of which one half is hidden
                    (side, *sorted(map(tuple, (places[list(turned)] / 8).tolist()))) in found
                    for turned in ((1, 2, 3), (1, 3, 0))
                )
                checked += 1
                assert hidden == (key not in found) or (other and not hidden)
    assert checked > 20


def test_a_place_belongs_to_the_cube_around_it():
    cubes = level(random_parts(np.random.default_rng(4), 2), 16).cubes
    assert (cubes.sizes**3).sum() == 16**3
    rng = np.random.default_rng(1)
    places = rng.integers(-2, 18, (400, 3))
    numbers = cubes.find(places)
    inside = ((places >= 0) & (places < 16)).all(1)
    assert ((numbers >= 0) == inside).all()
    low = cubes.origins[numbers[inside]]
    assert ((places[inside] >= low) & (places[inside] < low + cubes.sizes[numbers[inside], None])).all()


# ------------------------------------------------------------------------------------------------------------ polygons
@pytest.mark.parametrize("uv, count", [(0, 4), (0x40, 4), (0x42, 4), (0x80, 4), (0x88, 4), (0xC2, 0x84), (0x40, 0x84)])
def test_a_merged_face_has_its_polygon_at_one_cube(uv, count):
    """Two cubes along x; the first has the polygon of both, as a box of two corners."""
    box = struct.pack("<4H", 0, 0, 64, 128)  # along y and x
    twice = 2 if count & 0x80 else 1
    extra = (bytes(8 * twice) if uv & 2 else b"") + (bytes(2) if uv & 0x88 == 0x88 else b"")
    extra += bytes(4 * ((4 if uv & 0x42 == 0x40 else 0) + (2 if uv & 0x88 == 0x80 else 0)))
    extra += bytes(16) if uv & 0x42 == 0x40 and twice == 2 else b""
    parts = air()
    parts[0] = cube(SOLID, merged=1 << 5, polygons={5: (5 | uv, count, box + extra)})
    parts[1] = cube(SOLID, (1, 2, 3, 4, 5, 6), merged=1 << 5)
    slots, sides, corners, areas = drawn(parts, 16, 32)
    top = sides == 5
    assert top.sum() == 2 and (slots[top] == 1).all() and np.array_equal(areas[top].sum(0), [0, 0, 128])
    assert set(map(tuple, corners[top].reshape(-1, 3).tolist())) == {(0, 0, 8), (16, 0, 8), (16, 8, 8), (0, 8, 8)}


def test_the_third_coordinate_lies_in_the_plane_and_is_cut_off_toward_zero():
    """A slope from 8 at y = 0 to 3 at y = 8, in eighths; a corner at y = 12 eighths of a cube."""
    points = [(0, 0), (12, 0), (12, 64), (0, 64)]  # y and x
    parts = air()
    values = b"".join(struct.pack("<2H", *point) for point in points)
    parts[0] = cube(slope(2, 3, 8), merged=1 << 5, polygons={5: (4, 4, values)})
    found = level(parts, 16).cubes
    corner = found.corners(np.array([0]), np.array([5]))[0]
    normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    bias = -normal @ (corner[0] * 8)
    for (y, x), stored in zip(points, found.stored[0, :4], strict=True):
        exact = -(bias + normal[0] * x + normal[1] * y) / normal[2]
        assert stored.tolist() == [x, y, int(exact)]


@pytest.mark.parametrize("version", [29, 30, 31])
def test_merged_faces_before_version_32(version):
    parts = air()
    parts[0] = cube(SOLID, merged=1 << 5, boxes={5: (0, 64, 0, 128)})
    parts[1] = cube(SOLID, merged=1 << 5)
    _, sides, corners, areas = drawn(parts, 16, version)
    assert np.array_equal(areas[sides == 5].sum(0), [0, 0, 128])
    assert corners[sides == 5].reshape(-1, 3).max(0).tolist() == [16, 8, 8]


def test_polygons_of_a_face_itself_and_of_its_half():
    parts = air()
    for flags, count, corners in ((0, 4, [0, 1, 2, 3]), (1, 4, [1, 2, 3, 0]), (0, 3, [0, 1, 2]), (2, 3, [0, 2, 3])):
        parts[0] = cube(SOLID, polygons={1: (flags, count, b"")})
        found = level(parts, 16).cubes
        assert np.array_equal(found.stored[0, :count], CORNERS[1][corners] * 64)
        assert found.polygons.tolist() == [[0, 1, count]]


# ---------------------------------------------------------------------------------------------------- header and slots
@pytest.mark.parametrize("version", [20, 26, 28, *VERSIONS])
def test_every_version_has_the_same_cubes_and_entities(version):
    entities = [((1.0, 2.0, 3.0), 1, (100, 255, 0, 0))]
    variables = {"sunlight": 5, "scale": 0.5, "skybox": "a"}
    parts = [cube(SOLID), cube(slope()), *air(6)]
    found = level(parts, 64, version, entities=entities, variables=variables, slots=[3])
    assert (found.cubes.sizes == 32).all() and found.cubes.solid.tolist() == [True, *[False] * 7]
    assert found.entities["place"].tolist() == [[1, 2, 3]] and found.entities["values"][0, :2].tolist() == [100, 255]
    assert found.variables == ({} if version < 29 else variables)
    assert len(found.slots) == (3 if version > 29 else 0)


@pytest.mark.parametrize("version, stored, material", [(33, 0x400, 0x400), (33, 1, 1), (32, 4 << 5, 0x400), (31, 3, 3),
                                                       (31, 4 << 5, 0x400), (24, 1, 0)])  # fmt: skip
def test_materials(version, stored, material):
    assert level([cube(SOLID, material=stored), *air(7)], 16, version).cubes.material[0] == material


def test_texture_slots_and_their_changes(tmp_path):
    write_game(tmp_path)
    slots = [2, (1, 2 | 4 | 8, struct.pack("<f3i", 2.0, 3, 5, 7)), (2, 128, struct.pack("<3f", 0.5, 1, 9)), 1]
    slots.append((4, 1, struct.pack("<2H", 1, 3) + b"abc" + bytes(16)))  # a parameter of the shader alone
    found = read_textures(level(air(), 16, slots=slots), Files(tmp_path), "tiny")
    assert found[1] == Texture("packages/wall.png", "packages/wall_n.png", scale=2.0)
    assert found[2] == Texture("packages/wall.png", "packages/wall_n.png", 3, (5, 7), 2.0)
    assert found[3].color == (0.5, 1.0, 9.0) and found[3].rotation == 0 and found[3].scale == 2.0
    assert found[4] == Texture("packages/floor.png", None, 1, (8, 16), 0.5)
    assert found[5] == found[4]
    assert "not_a_normal_map" in CONFIG and len(found) == 6


def test_texture_coordinates():
    places = np.array([[8.0, 16, 24]])

    def at(side, **rest):
        return texture_coordinates(places, np.array([side]), Texture("x", **rest), (64, 128))[0].tolist()

    # Eight pixels a cube: along y and down z on sides of x, along x and down z on sides of y, along x and y on others.
    assert at(0) == at(1) == [16 * 8 / 64, -24 * 8 / 128]
    assert at(2) == [8 * 8 / 64, -24 * 8 / 128]
    assert at(5) == [8 * 8 / 64, 16 * 8 / 128]
    assert at(5, scale=2.0, offset=(32, 64)) == [8 * 4 / 64 - 0.5, 16 * 4 / 128 - 0.5]
    assert at(5, rotation=2) == [-8 * 8 / 64, -16 * 8 / 128]
    assert at(5, rotation=6) == [16 * 8 / 64, 8 * 8 / 128]


def test_files_outside_of_the_folder_are_not_read(tmp_path):
    write_game(tmp_path / "game")
    (tmp_path / "secret.png").write_bytes(b"x")
    files = Files(tmp_path / "game")
    assert files.path("../secret.png") is None and files.path("packages/wall.png") is not None
    assert files.size("packages/wall.png") == (32, 16) and files.size("packages/floor.png") == (8, 4)
    with pytest.raises(SceneError):
        files.map_file("../../x")
    with pytest.raises(SceneError):
        Files(tmp_path)


@pytest.mark.parametrize(
    "data",
    [
        b"", b"\x1f\x8b", hall()[:60], map_bytes(air(), 3), map_bytes(air(), 16, 34), map_bytes(air(), 16, 19),
        map_bytes([air(), *air(7)], 2),
    ],
    ids=["empty", "two bytes", "cut", "size", "newer", "older", "depth"],
)  # fmt: skip
def test_foreign_and_damaged_maps_are_one_line(data):
    with pytest.raises(SceneError) as caught:
        read_level(data, "tiny.ogz")
    assert "\n" not in str(caught.value) and caught.value.where


def test_a_tree_deeper_than_its_size_is_refused_before_it_is_read():
    deep = cube()
    for _ in range(40):
        deep = [deep, *air(7)]
    with pytest.raises(SceneError):
        level(deep, 64)
