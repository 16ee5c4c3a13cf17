"""Heightmaps against closed forms and SciPy, their files, made ones, and patches of them."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from features import patches, terrain, terrain_made
from motion.errors import UserError

RNG = np.random.default_rng(7)


def plane(x, z):
    return 0.3 * x - 0.2 * z + 0.1


def plane_map(*, rows=40, columns=30, spacing=0.1, **options):
    x, z = np.meshgrid(
        (np.arange(rows) - rows // 2) * spacing, (np.arange(columns) - columns // 2) * spacing, indexing="ij"
    )
    return terrain.Heightmap(plane(x, z), spacing, **options)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_plane_is_met_inside_and_goes_on_level_beyond_its_edges(compiled):
    ground = plane_map(compiled=compiled)
    x, z = RNG.uniform(-1.4, 1.3, (2, 50, 36))
    np.testing.assert_allclose(ground(x, z), plane(x, z), atol=1e-6)
    assert ground(x, z).shape == (50, 36) and ground(x, z).dtype == np.float32
    np.testing.assert_allclose(ground([9.0, -9.0], [0.0, 0.0]), [plane(1.9, 0), plane(-2, 0)], atol=1e-6)
    np.testing.assert_allclose(ground(0.0, [99.0, -99.0]), [plane(0, 1.4), plane(0, -1.5)], atol=1e-6)
    assert np.isnan(ground(np.nan, 0.0)) and np.isnan(ground(0.0, np.nan))
    assert float(ground(1e30, 0.0)) == pytest.approx(plane(1.9, 0), abs=1e-6)


def test_between_points_heights_are_scipys():
    heights = RNG.normal(size=(20, 31)).astype(np.float32)
    x, z = RNG.uniform(-0.49, 0.44, 500), RNG.uniform(-0.7, 0.74, 500)
    axes = [(np.arange(n) - n // 2) * 0.05 for n in heights.shape]
    truth = RegularGridInterpolator(axes, heights)(np.stack([x, z], axis=-1))
    for compiled in (True, False):
        ground = terrain.Heightmap(heights, 0.05, compiled=compiled)
        np.testing.assert_allclose(ground(x, z), truth, atol=2e-5)


def test_the_origin_moves_a_map_and_flat_is_flat():
    ground = plane_map(origin=(10.0, -4.0))
    assert float(ground(10.0, -4.0)) == pytest.approx(plane(-2.0, -1.5), abs=1e-6)
    assert terrain.flat(np.zeros((3, 1)), np.zeros(4)).tolist() == np.zeros((3, 4)).tolist()


def test_facts_of_a_plane_are_its_size_relief_and_slope(tmp_path):
    made = plane_map()
    facts = made.facts()
    assert facts["size_m"] == pytest.approx([3.9, 2.9])
    assert (facts["low_m"], facts["high_m"]) == pytest.approx((plane(-2.0, 1.4), plane(1.9, -1.5)))
    slopes = facts["slope_median"], facts["slope_p95"]
    assert slopes == pytest.approx(2 * (np.hypot(0.3, 0.2),), rel=1e-4)
    terrain.save(tmp_path / "plane.txt", made)
    read = terrain.load(tmp_path / "plane.txt", spacing=0.1, level=0).facts()
    assert read.pop("name") == str(tmp_path / "plane.txt") and facts.pop("name")
    for key, value in facts.items():
        assert read[key] == pytest.approx(value, rel=1e-4)
    sentence = terrain.told({"name": "plane.txt", **facts})
    assert "plane.txt: 3.9 x 2.9 m, -0.78 to 0.97 m high" in sentence and "36 % (median)" in sentence


def test_a_map_covers_what_lies_within_its_edges():
    ground = plane_map(origin=(10.0, -4.0))
    np.testing.assert_array_equal(
        ground.covers([10.0, 13.8, 14.0, 12.0, 12.0], [-4.0, -1.2, -2.0, -4.1, -2.0]), [1, 1, 0, 0, 1]
    )


def test_a_map_that_is_none_is_refused():
    for heights in (np.zeros(4), np.zeros((1, 4)), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="heights"):
            terrain.Heightmap(heights)
    with pytest.raises(ValueError, match="spacing"):
        terrain.Heightmap(np.zeros((2, 2)), 0.0)


def test_text_goes_out_and_comes_back(tmp_path):
    heights = RNG.normal(size=(7, 5)).astype(np.float32)
    path = tmp_path / "map.txt"
    terrain.save(path, terrain.Heightmap(heights))
    np.testing.assert_allclose(terrain.load(path, level=0).heights, heights, rtol=1e-5, atol=1e-6)
    path.write_text("# made by hand\n1 2 3\n\n4,5,6\n")
    small = terrain.load(path, spacing=0.5, unit=2.0)
    np.testing.assert_allclose(small.heights, [[-5, -3, -1], [1, 3, 5]])
    assert small.size == (0.5, 1.0) and float(small(-0.5, -0.5)) == -5


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1 2 3\n4 nan 6\n", r"map.txt:2: 'nan' is no height \(number 2"),
        ("1 2 3\n4 inf 6\n", r"map.txt:2: 'inf' is no height"),
        ("1 2 3\n4 -- 6\n", r"map.txt:2: '--' is no height \(number 2"),
        ("1 2 3\n\n4 5\n", r"map.txt:3: a row of 2 numbers, the first has 3"),
        ("1,2,3\n4,,6\n", r"map.txt:2: a row of 2 numbers"),
        ("height field\n", r"map.txt:1: 'height' is no height"),
        ("1 2 3\n", r"map.txt: a heightmap of one row of numbers"),
        ("1\n2\n3\n", r"map.txt: a heightmap of one number a row"),
        ("# nothing\n", r"map.txt: a heightmap of 0 rows"),
        ("1 2\n3 1e30\n", r"map.txt: a height of .* give its unit"),
        ("", "the file is empty"),
    ],
)
def test_bad_files_are_one_line(tmp_path, content, message):
    path = tmp_path / "map.txt"
    path.write_text(content)
    with pytest.raises(UserError, match=message) as error:
        terrain.load(path)
    assert "\n" not in str(error.value)


def test_bad_units_and_absent_files(tmp_path):
    path = tmp_path / "map.txt"
    with pytest.raises(UserError, match=r"map\.txt"):
        terrain.load(path)
    path.write_text("1 2\n3 4\n")
    for options in ({"spacing": 0.0}, {"unit": -1.0}, {"spacing": np.nan}):
        with pytest.raises(UserError, match=next(iter(options))):
            terrain.load(path, **options)


def test_the_published_map_has_the_size_and_slopes_of_a_landscape(data):
    ground = terrain.load(data / "pfnn/heightmaps/hmap_001_smooth.txt")
    assert ground.heights.shape == (504, 302)
    assert ground.size == pytest.approx((19.80, 11.85), abs=0.01)
    assert np.median(ground.heights) == pytest.approx(0, abs=1e-4)
    assert 0.05 < np.median(np.abs(np.diff(ground.heights, axis=0))) / ground.spacing < 0.5


@pytest.mark.parametrize("kind", terrain_made.KINDS)
def test_made_terrain_is_the_seeds(kind):
    one, same, other = (terrain_made.make(seed, kind, size=(6, 4)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.heights, same.heights)
    assert not np.array_equal(one.heights, other.heights)
    assert one.size == pytest.approx((6, 4), abs=0.05)
    assert 0.05 < one.heights.std() < 1 and abs(np.median(one.heights)) < 1e-5
    higher = terrain_made.make(1, kind, size=(6, 4), scale=2.0)
    np.testing.assert_allclose(higher.heights, 2 * one.heights, rtol=1e-5)


def test_made_terrain_is_what_its_kind_says():
    slope = {kind: np.abs(np.diff(terrain_made.make(3, kind).heights, axis=0)) for kind in terrain_made.KINDS}
    steep = {kind: (diff > terrain.SPACING).mean() for kind, diff in slope.items()}  # 45 degrees
    level = {kind: (diff < 1e-4).mean() for kind, diff in slope.items()}
    assert steep["hills"] == 0 and steep["slopes"] < 0.02 and 0.01 < steep["steps"] < 0.2
    assert level["steps"] > 0.7 and max(level["hills"], level["slopes"]) < 0.1
    bend = np.abs(np.diff(terrain_made.make(3, "slopes").heights, n=2, axis=0))
    assert (bend < 1e-5).mean() > 0.85  # planes


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "lava"}, "hills, slopes, steps, mixed"),
        ({"spacing": 0.0}, "spacing"),
        ({"size": (4.0, -1.0)}, "size"),
        ({"scale": np.nan}, "scale"),
        ({"size": (1e5, 1e5)}, "make it smaller"),
    ],
)
def test_terrain_that_cannot_be_made(options, message):
    with pytest.raises(UserError, match=message):
        terrain_made.make(0, **options)


def test_a_patch_is_its_map_turned_and_mirrored():
    """Of a plane every patch is a plane of the same steepness, the mean of its probes at 0."""
    ground = plane_map(rows=400, columns=400)
    some = patches.cut([ground], count=50, side=1.0, seed=3)
    middles = (some.transforms[..., 2] - 200) * ground.spacing
    inside = np.abs(middles).max(axis=1) < 18
    points = RNG.uniform(-0.5, 0.5, (200, 2))
    heights = some.heights(points)[inside]
    terms = np.concatenate([points, np.ones((200, 1))], axis=1)
    fits = np.linalg.lstsq(terms, heights.T, rcond=None)[0]
    np.testing.assert_allclose(terms @ fits, heights.T, atol=1e-5)
    np.testing.assert_allclose(np.hypot(fits[0], fits[1]), np.hypot(0.3, 0.2), atol=1e-5)
    np.testing.assert_allclose(fits[2], 0, atol=1e-5)
    turned = np.linalg.det(some.transforms[..., :2]) > 0
    assert 10 < turned.sum() < 40 and np.ptp(np.arctan2(fits[0], fits[1])) > 5


def test_patches_go_on_as_in_a_mirror_and_compiled_as_plainly():
    heights = RNG.normal(size=(9, 7)).astype(np.float32)
    fast, plain = (terrain.Heightmap(heights, 0.1, compiled=flag) for flag in (True, False))
    transforms = np.array([[[10.0, 0, 0], [0, 10.0, 0]], [[7.0, -7.0, 3.5], [7.0, 7.0, -40.2]]])
    points = RNG.uniform(-4, 4, (300, 2))
    one, other = (
        patches.Patches((ground,), np.zeros(2, np.int64), transforms, np.zeros(2)) for ground in (fast, plain)
    )
    np.testing.assert_allclose(one.heights(points), other.heights(points), atol=1e-6)
    rows = np.pad(heights, 30, mode="reflect")[30:, 30:]
    on_grid = one[0].heights(
        np.stack(np.meshgrid(np.arange(30), np.arange(25), indexing="ij"), -1).reshape(-1, 2) / 10
    )
    np.testing.assert_allclose(on_grid.reshape(30, 25), rows[:30, :25], atol=1e-5)
    down, up, down_y, up_y = points[:40], points[40:90], RNG.normal(size=40), RNG.normal(size=50)
    feet = (down, down_y, up, up_y, (RNG.random(50) < 0.5).astype(float))
    np.testing.assert_allclose(
        one.misfits(*feet, weight=0.3, gap=0.2), other.misfits(*feet, weight=0.3, gap=0.2), rtol=1e-6
    )


def test_patches_of_several_maps_come_from_all_and_rough_ones_from_none():
    maps = [terrain_made.make(seed, "steps", size=(8, 8)) for seed in (1, 2)]
    some = patches.cut(maps, count=60, seed=1)
    assert len(some) == 60 and set(some.which) == {0, 1}
    probes = np.stack(np.meshgrid(*2 * [np.linspace(-2, 2, 9)]), -1).reshape(-1, 2)
    assert np.abs(some.heights(probes)).max() <= patches.ROUGHEST
    again = patches.cut(maps, count=60, seed=1)
    np.testing.assert_array_equal(some.transforms, again.transforms)
    mixed = some[[5, 3]]
    np.testing.assert_array_equal(mixed.heights(probes), some.heights(probes)[[5, 3]])
    with pytest.raises(UserError, match="of their mean"):
        patches.cut(maps, count=60, roughest=0.01)
    with pytest.raises(UserError, match="no heightmap"):
        patches.cut([])
    with pytest.raises(UserError, match="count"):
        patches.cut(maps, count=0)
