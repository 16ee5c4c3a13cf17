from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import viewer_scenes as scenes

from viewer import camera, shapes
from viewer.camera import Camera
from viewer.raster import Renderer, kernels, kernels_numpy, text
from viewer.scene import (
    DARK,
    LIGHT,
    Arrows,
    Ground,
    Labels,
    Lines,
    Mesh,
    Points,
    Scene,
    Surface,
    Theme,
    colour,
)

BLACK = replace(LIGHT, zenith="#000000", horizon="#000000", floor="#000000", lines="#000000")


def picture(
    scene: Scene, eye: Camera, size: tuple[int, int] = (96, 64), *, compiled: bool = True
) -> np.ndarray:
    return Renderer(*size, compiled=compiled).render(scene, eye)


def covered(image: np.ndarray, background: np.ndarray, full: np.ndarray) -> float:
    """Pixels that are covered, counted by how far their colour is from the background's to the full one."""
    span = full.astype(float) - background
    return float(((image.astype(float) - background) @ span / (span @ span)).sum())


def on_black(*meshes: Mesh, **more: object) -> Scene:
    found = scenes.scene(*meshes, **more)
    found.theme = BLACK
    return found


def test_a_rectangle_is_where_and_as_large_as_projection_says() -> None:
    eye, size = scenes.ahead(5.0, field=0.6), (96, 64)
    image = picture(on_black(scenes.rectangle((0.3, -0.2, 0), 0.81, 0.57)), eye, size)
    (x, y), _ = camera.project(eye, [0.3, -0.2, 0], *size)
    metre = camera.focal(eye, size[1]) / 5
    full = image[round(y), round(x)]
    assert full[0] > 100 > 30 > full[2]
    assert covered(image, np.zeros(3), full) == pytest.approx(0.81 * 0.57 * metre**2, rel=0.02)
    weight = image[..., 0] / image[..., 0].sum()
    rows, columns = np.mgrid[: size[1], : size[0]] + 0.5
    assert np.sum(weight * columns) == pytest.approx(x, abs=0.25)
    assert np.sum(weight * rows) == pytest.approx(y, abs=0.25)


@pytest.mark.parametrize("order", [1, -1])
def test_what_is_nearer_hides_what_is_behind(order: int) -> None:
    near = scenes.rectangle((0, 0, 1), 1, 1, scenes.RED)
    far = scenes.rectangle((0, 0, 0), 2, 2, scenes.BLUE)
    image = picture(on_black(*[near, far][::order]), scenes.ahead())
    assert image[32, 48].argmax() == 0
    assert image[32, 48 + 14].argmax() == 2  # 0.65 m aside at 5 m, beyond the nearer one


def test_surfaces_that_pierce_each_other_meet_where_geometry_says() -> None:
    flat = scenes.rectangle((0, 0, 0), 2, 2, scenes.BLUE)
    tilted = scenes.rectangle((0, 0, 0), 2, 2, scenes.RED)
    vertices = tilted.vertices + np.array([0, 0, 1]) * tilted.vertices[:, :1]  # nearer to the right
    image = picture(
        on_black(flat, Mesh(vertices, tilted.normals, tilted.triangles, scenes.RED)), scenes.ahead()
    )
    row = image[32].astype(int)
    assert (row[30:47, 2] > row[30:47, 0]).all()
    assert (row[50:66, 0] > row[50:66, 2]).all()


def test_the_back_of_a_body_is_not_drawn_but_that_of_a_two_sided_surface_is() -> None:
    mesh = scenes.rectangle((0, 0, 0), 1, 1)
    behind = camera.orbit([0, 0, 0], azimuth=np.pi, elevation=0.0, distance=5.0)
    assert not picture(on_black(mesh), behind).any()
    sheet = Scene({"sheet": Surface(mesh=mesh, two_sided=True)}, ground=None, theme=BLACK)
    assert picture(sheet, behind)[32, 48, 0] > 50


def test_triangles_that_reach_behind_the_camera_are_drawn_before_it() -> None:
    corners = np.array([[-40, -1, 20], [40, -1, 20], [40, -1, -30], [-40, -1, -30]], np.float32)
    up = np.tile([0, 1, 0], (4, 1)).astype(np.float32)
    floor = Mesh(corners, up, np.array([[0, 1, 2], [0, 2, 3]], np.int32), scenes.RED)
    image = picture(on_black(floor), scenes.ahead(5.0))
    lit = image[..., 0] > 0
    assert not lit[:32].any()
    # The far edge, 35 m away and 1 m down, and all below it.
    edge = 32 + camera.focal(scenes.ahead(5.0), 64) / 35
    assert lit[int(np.ceil(edge)) :].all()


def test_edges_are_smooth() -> None:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0]], np.float32)
    mesh = Mesh(
        corners, np.tile([0, 0, 1], (3, 1)).astype(np.float32), np.array([[0, 1, 2]], np.int32), scenes.RED
    )
    image = picture(on_black(mesh), scenes.ahead())
    assert len(np.unique(image[..., 0])) > 4


def test_light_comes_from_the_sun() -> None:
    ball = shapes.ellipsoid([0, 0, 0], np.eye(3), np.full(3, 0.6))
    scene = on_black(ball)
    scene.sun = replace(scene.sun, direction=(1.0, 0.4, 0.3))
    image = picture(scene, scenes.ahead(), (64, 64))
    assert image[32, 50].mean() > 1.5 * image[32, 14].mean()


def test_the_shadow_lies_where_the_light_leads() -> None:
    ball = shapes.ellipsoid([0, 1.0, 0], np.eye(3) * 0.2, np.full(3, 0.6))
    scene = Scene({"ball": scenes.solids(ball)}, theme=replace(LIGHT, lines=LIGHT.floor))
    scene.sun = replace(scene.sun, direction=(0.5, 1.0, 0.0))
    eye = camera.orbit([0, 0, 0], azimuth=0.0, elevation=1.2, distance=6.0, field=0.6)
    image = picture(scene, eye, (96, 96)).astype(float)
    scene.layers["ball"].update(shadow=False)
    bare = picture(scene, eye, (96, 96)).astype(float)
    dark = (bare - image).sum(axis=-1)
    assert dark.max() > 50
    rows, columns = np.mgrid[:96, :96] + 0.5
    place = np.array([np.sum(dark * columns), np.sum(dark * rows)]) / dark.sum()
    expected, _ = camera.project(eye, [-0.5, 0, 0], 96, 96)
    np.testing.assert_allclose(place, expected, atol=0.6)


def slope(share: float, below: float) -> Surface:
    """Ground that rises by a share of z; at the origin it lies below by so much."""
    corners = np.array([[x, share * z - below, z] for x in (-4, 4) for z in (-4, 4)], np.float32)
    normals = np.tile(np.array([0, 1, -share]) / np.hypot(1, share), (4, 1)).astype(np.float32)
    mesh = Mesh(corners, normals, np.array([[0, 1, 2], [1, 3, 2]], np.int32), np.full(3, 0.7, np.float32))
    return Surface(mesh=mesh, shadow=False, shaded=True)


@pytest.mark.parametrize(("share", "below"), [(0.0, 0.5), (0.4, 0.0), (-0.3, 1.0)])
def test_shadows_fall_on_uneven_ground_where_the_light_leads(share: float, below: float) -> None:
    ball = shapes.ellipsoid([0, 1.0, 0], np.eye(3) * 0.15, np.full(3, 0.6))
    scene = Scene({"ball": scenes.solids(ball), "slope": slope(share, below)}, ground=None)
    scene.sun = replace(scene.sun, direction=(0.4, 1.0, -0.3))
    eye = camera.orbit([0, 0, 0], azimuth=0.0, elevation=1.2, distance=7.0, field=0.6)
    image = picture(scene, eye, (96, 96)).astype(float)
    scene.layers["ball"].update(shadow=False)
    dark = (picture(scene, eye, (96, 96)) - image).sum(axis=-1)
    assert dark.max() > 50
    rows, columns = np.mgrid[:96, :96] + 0.5
    place = np.array([np.sum(dark * columns), np.sum(dark * rows)]) / dark.sum()
    # Down from the middle of the ball by t: (-0.4 t, 1 - t, 0.3 t) is on the slope.
    t = (1 + below) / (1 + 0.3 * share)
    expected, _ = camera.project(eye, [-0.4 * t, 1 - t, 0.3 * t], 96, 96)
    np.testing.assert_allclose(place, expected, atol=0.7)


def test_rims_of_rounded_surfaces_are_no_darker_than_what_is_beside_them() -> None:
    """Where the normals of a triangle that is seen begin to face away."""
    means = []
    for away in (-0.02, 0.02):
        wall = scenes.rectangle((0, 0, 0), 2, 2)
        tilted = np.tile(np.array([0, 1, -away], np.float32), (4, 1))
        scene = on_black(Mesh(wall.vertices, tilted, wall.triangles, wall.colours))
        means.append(picture(scene, scenes.ahead(), (32, 32))[8:24, 8:24, 0].mean())
    assert means[1] == pytest.approx(means[0], abs=6)


def test_the_grid_has_a_line_every_metre_and_fades() -> None:
    scene = Scene(ground=Ground(spacing=1.0, centre=(0.0, 0.0), radius=12.0))
    eye = camera.orbit([0, 0, 0], azimuth=0.0, elevation=1.4, distance=8.0)
    image = picture(scene, eye, (320, 240)).astype(float).mean(axis=-1)
    metre = camera.focal(eye, 240) / 8
    across = image[120 - int(0.5 * metre)]  # between two lines that go from left to right
    dips = np.flatnonzero(
        (across[1:-1] < across[:-2]) & (across[1:-1] <= across[2:]) & (across[1:-1] < across.max() - 4)
    )
    assert np.diff(dips).mean() == pytest.approx(metre, rel=0.1)
    low = camera.orbit([0, 1, 0], azimuth=0.0, elevation=0.05, distance=8.0)
    scene.ground = Ground(radius=5.0)
    far = picture(scene, low, (64, 48))
    horizon = np.round(255 * colour(LIGHT.horizon))
    np.testing.assert_allclose(far[26], np.tile(horizon, (64, 1)), atol=1)


def test_feet_below_the_ground_are_hidden_by_it() -> None:
    eye = camera.orbit([0, 0, 0], azimuth=0.0, elevation=0.3, distance=5.0)
    buried = scenes.solids(scenes.rectangle((0, -0.5, 0), 1, 0.9), shadow=False)
    scene = Scene({"solids": buried})
    empty = picture(Scene(), eye)
    assert np.array_equal(picture(scene, eye), empty)
    scene.ground = None
    assert not np.array_equal(picture(scene, eye), picture(Scene(ground=None), eye))


def test_what_is_half_clear_mixes_with_what_is_behind() -> None:
    front = scenes.rectangle((0, 0, 1), 1, 1, scenes.RED)
    scene = on_black(scenes.rectangle((0, 0, 0), 3, 3, scenes.BLUE))
    scene.layers["ghost"] = scenes.solids(front, opacity=0.5)
    mixed = picture(scene, scenes.ahead())[32, 48].astype(int)
    scene.layers["ghost"].update(opacity=1.0)
    solid = picture(scene, scenes.ahead())[32, 48].astype(int)
    scene.layers["ghost"].update(visible=False)
    behind = picture(scene, scenes.ahead())[32, 48].astype(int)
    np.testing.assert_allclose(mixed, (solid + behind) / 2, atol=1.5)


def test_lines_are_as_wide_as_asked_and_hidden_behind_bodies() -> None:
    line = Lines(points=[[-1, 0, 0.5], [1, 0, 0.5]], colours=np.ones(3), width=4.0)  # type: ignore[arg-type]
    scene = Scene({"line": line}, ground=None, theme=BLACK)
    size = (96, 720)  # where widths are pixels
    eye = scenes.ahead(5.0, field=2.0)
    image = picture(scene, eye, size)
    assert image[:, 48, 0].sum() / 255 == pytest.approx(4.0, abs=0.1)
    scene.layers["wall"] = scenes.solids(scenes.rectangle((0, 0, 1), 1, 1, scenes.BLUE))
    assert picture(scene, eye, size)[360, 48, 1] < 20
    line.update(through=0.5)
    assert abs(int(picture(scene, eye, size)[360, 48, 1]) - 130) <= 4
    line.update(points=np.array([[-1, 0, 1.5], [1, 0, 1.5]]))
    assert picture(scene, eye, size)[360, 48, 1] > 250


def test_points_are_round() -> None:
    points = Points(positions=[[0, 0, 0]], colours=np.ones(3), size=20.0)  # type: ignore[arg-type]
    image = picture(Scene({"p": points}, ground=None, theme=BLACK), scenes.ahead(field=2.0), (100, 720))
    assert image[..., 0].sum() / 255 == pytest.approx(np.pi * 100, rel=0.02)


def test_arrows_point_to_their_ends() -> None:
    arrow = Arrows(origins=[[-1, 0, 0]], vectors=[[2, 0, 0]], colours=scenes.RED, radius=0.05)  # type: ignore[arg-type]
    image = picture(Scene({"a": arrow}, ground=None, theme=BLACK), scenes.ahead(4.0, field=1.0), (128, 96))
    columns = np.flatnonzero(image[..., 0].max(axis=0) > 40)
    metre = camera.focal(scenes.ahead(4.0, field=1.0), 96) / 4
    np.testing.assert_allclose(columns[[0, -1]], 64 + metre * np.array([-1, 1]), atol=3)
    thick = (image[..., 0] > 40).sum(axis=0)
    assert thick[64 + int(0.8 * metre)] > thick[64]  # the head


def test_labels_stand_above_their_places() -> None:
    labels = Labels(texts=["walk", " "], positions=[[0, 0, 0], [0, -1, 0]], size=100.0)  # type: ignore[arg-type]
    plain = picture(Scene(ground=None), scenes.ahead(), (160, 120))
    image = picture(Scene({"l": labels}, ground=None), scenes.ahead(), (160, 120))
    rows, columns = np.nonzero((image != plain).any(axis=-1))
    assert rows.min() > 40 and rows.max() <= 60
    assert (columns.min() + columns.max()) / 2 == pytest.approx(79.5, abs=2)
    labels.update(positions=np.array([[0, 0, 9.0], [0, 0, 0]]))  # behind the camera
    assert np.array_equal(picture(Scene({"l": labels}, ground=None), scenes.ahead(), (160, 120)), plain)


def test_stamps_are_cut_off_at_the_border() -> None:
    image = np.zeros((10, 10, 3), np.uint8)
    stamp = np.full((4, 4, 4), 255, np.uint8)
    for left, top, count in ((-2, -2, 4), (8, 8, 4), (3, 20, 0), (-9, 0, 0)):
        image[:] = 0
        text.put(image, stamp, left, top)
        assert (image[..., 0] == 255).sum() == count


def test_a_renderer_forgets_the_frame_before() -> None:
    renderer, eye = Renderer(96, 64), scenes.ahead()
    empty = Scene(ground=None)
    before = renderer.render(empty, eye)
    renderer.render(scenes.scene(scenes.rectangle((0, 0, 0), 9, 9)), eye)
    assert np.array_equal(renderer.render(empty, eye), before)
    with pytest.raises(ValueError, match="0 x 5"):
        Renderer(0, 5)


def busy(theme: Theme) -> Scene:
    rng = np.random.default_rng(3)
    meshes = [
        shapes.ellipsoid(rng.normal((0, 0.8, 0), 0.5), np.eye(3) * 0.3, rng.uniform(0.1, 0.9, 3))
        for _ in range(4)
    ]
    scene = Scene({"balls": scenes.solids(*meshes)}, theme=theme)
    scene.layers["ghost"] = scenes.solids(
        shapes.capsule([0.6, 0, 0.5], [0.6, 1, 0], (0.2, 0.1), scenes.BLUE), opacity=0.4
    )
    scene.layers["line"] = Lines(
        points=rng.normal(0, 1, (6, 3)), starts=np.array([0, 4]), width=30.0, through=0.3
    )
    scene.layers["points"] = Points(positions=rng.normal(0, 1, (3, 3)), size=60.0)
    return scene


@pytest.mark.parametrize(("theme", "uneven"), [(LIGHT, False), (DARK, False), (LIGHT, True)])
def test_compiled_loops_draw_what_their_plain_twins_draw(theme: Theme, uneven: bool) -> None:
    scene = busy(theme)
    if uneven:
        scene.ground, scene.layers["slope"] = None, slope(0.2, 0.1)
    eye = camera.orbit([0, 0.6, 0], azimuth=0.4, elevation=0.35, distance=4.0)
    fast, plain = (picture(scene, eye, (56, 40), compiled=c).astype(int) for c in (True, False))
    off = np.abs(fast - plain).max(axis=-1)
    assert np.median(off) <= 1
    # A sample on an edge may fall to either side; a pixel is shaded once for all of one surface.
    assert np.percentile(off, 98) <= 6
    assert (off > 40).mean() < 0.004


def test_compiled_visibility_is_that_of_trying_everything() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform([-10, -10, 0], [60, 40, 0], (60, 3))
    places[:, 2] = rng.uniform(0.3, 4, 60)
    places[:6, 2] = rng.uniform(-2, 0.1, 6)  # behind the camera
    places[:, :2] *= places[:, 2:]
    triangles = np.arange(60, dtype=np.int32).reshape(20, 3)
    found = []
    for loops in (kernels, kernels_numpy):
        depth, ids = np.zeros((30, 50), np.float32), np.full((30, 50), -1, np.int32)
        low, high, shares = np.full(30, 50), np.zeros(30, np.int64), np.zeros((20, 3, 3))
        loops.visibility(
            *(places, triangles, np.arange(20) % 2 == 0, 0.05, np.full(30, 0.28, np.float32)),
            *(depth, ids, low, high, shares),
        )
        found.append((depth, ids))
    assert len(np.unique(found[1][1])) > 8
    assert (found[0][1] != found[1][1]).sum() <= 2
    np.testing.assert_allclose(*(np.where(found[0][1] == found[1][1], d, 0) for d, _ in found), rtol=1e-5)


def test_shadows_are_cast_and_blurred_as_by_their_twins() -> None:
    mesh = shapes.ellipsoid([0.5, 0.6, 0.4], np.eye(3) * 0.25, np.ones(3))
    masks = []
    for loops in (kernels, kernels_numpy):
        mask, soft = np.zeros((40, 50), np.float32), np.empty((50, 40), np.float32)
        loops.cast(mesh.vertices, mesh.triangles, np.array([-0.3, 0.2]), np.array([-0.1, 0.0]), 0.02, mask)
        loops.blur(mask, 3, soft)
        masks.append((mask, soft))
    assert (masks[0][0] != masks[1][0]).sum() <= 3
    np.testing.assert_allclose(masks[0][1], masks[1][1], atol=0.2)
    kernels.blur(masks[1][0], 3, soft)
    np.testing.assert_allclose(soft, masks[1][1], atol=1e-5)
