from dataclasses import replace

import numpy as np
import pytest
from still import Still, cube_scene

from taichi_jello import Keyframe, Region
from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.physics.colliders.sphere import Sphere
from taichi_jello.scene.description import Scene
from taichi_jello.shapes.ball import Ball, sphere
from taichi_jello.shapes.lattice import Box
from taichi_jello.shapes.mesh import Mesh
from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem
from taichi_jello.view.drawing.embedded import Embedded
from taichi_jello.view.drawing.scale import round_up
from taichi_jello.view.drawing.springs import layers, ramp_table
from taichi_jello.view.drawing.subdivide import subdivide
from taichi_jello.view.render.renderers import drawing_of, open_renderer, picture


def drawing_at(simulation, **options):
    drawing = drawing_of(simulation)
    drawing.update(simulation.x, simulation.v, simulation.time, **options)
    return drawing


def test_scales_end_at_one_two_or_five():
    values = (0.011, 0.02, 0.021, 3.0, 5.1, 99.0, 100.0, 0.0, float("inf"))
    assert [round_up(v) for v in values] == pytest.approx([0.02, 0.02, 0.05, 5.0, 10.0, 100.0, 100.0, 1.0, 1.0])


def test_the_scale_is_never_lowered_but_where_the_scene_begins_again(cube):
    """A moment of more force raises it; another of as little as before leaves it there."""
    drawing, ends = drawing_of(cube), []
    for time, stretch in ((0.0, 1.0), (0.1, 3.0), (0.2, 1.0), (0.1, 5.0), (0.3, 1.0), (0.0, 1.0)):
        cube.put(stretch * cube.body.x)
        drawing.update(cube.x, cube.v, time)
        ends.append(drawing.key.most)
    assert ends[0] < ends[1] == ends[2] < ends[3] == ends[4] > ends[5] == ends[0]


def test_strain_of_a_uniform_stretch_is_read_off_the_legend(cube):
    drawing = drawing_at(cube.put(1.2 * cube.body.x), color="strain")
    assert (drawing.key.unit, drawing.key.most) == ("%", pytest.approx(20.0))
    assert np.allclose(drawing.springs.load, 0.2, atol=1e-5)
    assert np.allclose(drawing.springs.lines.rgb, ramp_table()[-1], atol=0.03)


def test_force_counts_spring_and_dashpot(cube):
    """A cube at rest length that grows at the rate 1/s: every spring carries damping times its length."""
    drawing = drawing_at(cube.put(cube.body.x, cube.body.x))
    expected = np.sort(cube.body.damping * cube.body.rest_length)
    assert np.allclose(np.sort(drawing.springs.load), expected, rtol=1e-3)


def test_what_a_scene_lacks_is_not_there():
    chain = drawing_at(Still(Scene(jello=(Box(points=(1, 1, 6)),))))
    assert chain.skin is None and chain.surroundings is None and chain.opaque == [] and chain.blended is None
    dot = drawing_at(Still(Scene(jello=(Box(points=(1, 1, 1)),))))
    assert dot.springs is None and dot.lines == [] and dot.key.ramp is None


def test_a_scene_of_one_ball_draws():
    drawing = drawing_at(Still(Scene(jello=(Box(points=(2, 2, 2)),), collider=(Sphere(center=(0, -2, 0)),))))
    assert drawing.shadows == [] and len(drawing.opaque) == 1


def test_springs_that_are_all_out_of_sight_have_a_legend(tmp_path):
    """Of a mesh in a single cell all springs lie outside, and all particles."""
    points, triangles = sphere(0.5)
    lines = [f"v {x} {y} {z}\n" for x, y, z in points] + ["f {} {} {}\n".format(*t) for t in triangles + 1]
    (tmp_path / "ball.obj").write_text("".join(lines))
    still = Still(Scene(jello=(Mesh(file=str(tmp_path / "ball.obj"), resolution=1),)))
    for color in ("force", "strain", "stiffness", "family"):
        drawing = drawing_at(still, color=color)
        assert len(drawing.springs.lines.x) == 0 and drawing.dots is None and drawing.blended is not None


def test_a_dense_body_shows_structural_springs_first():
    body = Still(cube_scene(points=6)).body
    layer = layers(body)
    assert set(body.family[layer == 0]) == {0} and set(layer) == {0, 1, 2}
    assert np.all(layer[body.family == 0] == 0)


def test_fine_skin_lies_on_the_coarse_one_and_bevels_its_edges():
    body = Box(points=(4, 4, 4)).body()
    fine = subdivide(body.rest, body.surface)
    assert len(fine.index) == 9 * len(body.surface)
    x = np.einsum("vk,vki->vi", fine.share, body.rest[fine.parent])
    assert np.allclose(np.abs(x).max(1), 0.5)
    a, b, c = (x[fine.index[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    assert np.linalg.norm(n, axis=1).sum() / 2 == pytest.approx(6.0)
    assert np.all(np.einsum("ij,ij->i", n, a) > 0.0)  # outward, as the coarse ones
    assert np.unique(np.round(x, 6), axis=0).shape == x.shape  # welded over the cube's edges


def test_a_sheet_keeps_its_two_sides_apart():
    body = Box(points=(4, 1, 4)).body()
    fine = subdivide(body.rest, body.surface)
    side = np.sign(np.cross(*(body.rest[body.surface[:, k]] - body.rest[body.surface[:, 0]] for k in (1, 2)))[:, 1])
    for start, end in zip(fine.start[:-1], fine.start[1:], strict=True):
        assert len(set(side[fine.item[start:end] // 3])) == 1


def test_inner_sides_are_blended_before_outer_ones(cube):
    drawing = drawing_at(cube)
    skin = drawing.blended
    a, b, c = (skin.x[skin.index[:, k]] for k in range(3))
    outer = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - drawing.viewpoint.eye) < 0.0
    assert outer.any() and not outer.all()
    assert np.all(np.diff(outer.astype(int)) >= 0)


def test_wrong_wishes_are_named(cube):
    with pytest.raises(ValueError, match="color"):
        drawing_at(cube, color="heat")
    for wish in ({"name": "metal"}, {"size": (8, 8)}, {"samples": 3}):
        with pytest.raises(RuntimeProblem, match=next(iter(wish)) if "name" not in wish else "renderer"):
            open_renderer(**wish)


def test_ggui_without_a_driver_says_so(monkeypatch):
    monkeypatch.setattr("taichi_jello.view.render.ggui.has_vulkan", lambda: False)
    with pytest.raises(RuntimeProblem, match="Vulkan"):
        open_renderer("ggui")
    assert open_renderer("auto", (64, 64)).name == "raster"


def test_a_window_without_a_screen_says_so(monkeypatch, cube):
    from taichi_jello.view.window.play import play

    monkeypatch.setattr("taichi_jello.view.render.ggui.has_vulkan", lambda: True)
    monkeypatch.setenv("DISPLAY", ":987")
    with pytest.raises(RuntimeProblem, match=":987"):
        play(cube)


def test_picture_leaves_nothing_behind(tmp_path, monkeypatch, cube):
    monkeypatch.chdir(tmp_path)
    image = picture(cube, (160, 90), samples=1)
    assert image.shape == (90, 160, 3) and image.dtype == np.uint8
    assert list(tmp_path.iterdir()) == []


def test_a_dead_start_is_noticed(cube):
    drawing, renderer = drawing_at(cube), open_renderer("raster", (64, 64), 1)
    runtime.start()
    with pytest.raises(RuntimeProblem, match="again"):
        renderer.draw(drawing, drawing.viewpoint)


def test_an_embedded_skin_is_drawn_and_its_scaffold_is_not():
    ball = Ball(resolution=6, radius=0.4, position=(0.0, 0.5, 0.0))
    both = Still(Scene(jello=(ball, Box(points=(3, 3, 3), position=(2.0, 0.5, 0.0))), collider=(Plane(),)))
    drawing = drawing_at(both)
    middle, skin = np.array([0.0, 0.5, 0.0]), drawing.skin
    round_ones = skin.owner == 0
    points = skin.triangles.x[skin.index[round_ones]].reshape(-1, 3)
    assert np.linalg.norm(points - middle, axis=1) == pytest.approx(0.4, abs=1e-5)
    # The mean of the facets' normals around a point of a sphere is its direction, to the square of their angle.
    normals = skin.normal[skin.index[round_ones]].reshape(-1, 3)
    assert normals == pytest.approx((points - middle) / 0.4, abs=0.05)
    ends = drawing.lines[-1].x
    own = ends[ends[:, 0] < 1.0]
    assert len(own) > 100 and np.linalg.norm(own - middle, axis=1).max() < 0.42  # drawn a little nearer to the eye
    dots = drawing.dots.x[drawing.dots.x[:, 0] < 1.0]
    assert len(dots) > 30 and np.linalg.norm(dots - middle, axis=1).max() <= 0.4 + 1e-6


def test_sharp_edges_of_an_embedded_skin_stay_sharp():
    """A cube of two triangles a side: every corner is drawn three times, with the normals of its sides."""
    cube = Box(points=(2, 2, 2)).body()
    body = replace(cube, skin=cube.surface, skin_corners=np.tile(cube.cells, (8, 1)), skin_weights=np.eye(8))
    embedded = Embedded(body)
    assert len(embedded) == 24 and len(embedded.index) == 12
    points = np.zeros((24, 3), np.float32)
    embedded.update(body.x.astype(np.float32), points)
    assert np.sort(np.abs(embedded.normals), 1) == pytest.approx(np.tile([0.0, 0.0, 1.0], (24, 1)))
    assert np.einsum("ij,ij->i", embedded.normals, points) == pytest.approx(0.5)
    # Sheared, stretched and crushed, they stand on the triangles as these are then.
    x = body.x @ np.array([[1.0, 0.3, 0.0], [0.0, 0.2, 0.5], [0.4, 0.0, -2.0]])
    embedded.update(x.astype(np.float32), points)
    a, b, c = (points[embedded.index[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    for k in range(3):
        assert embedded.normals[embedded.index[:, k]] == pytest.approx(flat, abs=1e-5)


def test_torn_springs_and_the_skin_over_them_are_not_drawn():
    still = Still(Scene(jello=(Box(points=(6, 4, 4), tear_strain=0.5),)))
    drawing = drawing_at(still, color="strain")
    drawn, faces = drawing.springs.lines.x.copy(), len(drawing.skin.triangles.index)
    side = still.body.rest[:, 0][still.body.springs] > 0.0
    memory = {"whole": side[:, 0] == side[:, 1], "rest_length": still.body.rest_length}
    apart = still.body.x + np.where(still.body.x[:, :1] > 0.0, 0.7, 0.0)
    drawing.update(apart, still.v, 0.0, color="strain", memory=memory)
    ends = drawing.springs.lines.x.reshape(-1, 2, 3)
    crosses = drawn.reshape(-1, 2, 3)[:, :, 0].prod(1) < 0.0
    assert np.array_equal(np.all(ends[:, 0] == ends[:, 1], axis=1), crosses)
    assert drawing.springs.load.max() < 1e-5
    corners = drawing.skin.triangles.x[drawing.skin.triangles.index]
    assert np.ptp(corners[:, :, 0], axis=1).max() < 0.5
    drawing.update(still.x, still.v, 0.0)
    assert len(drawing.skin.triangles.index) == faces


def test_stiffness_is_read_off_the_legend():
    half = Region(max=(0.5, 1.0, 1.0), stiffness=50.0)
    melted = Keyframe(time=0.0, stiffness=0.5)
    still = Still(Scene(jello=(Box(points=(4, 4, 4), region=[half], keyframe=[melted]),)))
    drawing = drawing_at(still, color="stiffness")
    assert (drawing.key.title, drawing.key.unit, drawing.key.most) == ("stiffness", "N/m", pytest.approx(100.0))
    colors = np.unique(drawing.springs.lines.rgb, axis=0)
    assert len(colors) == 2
    assert any(np.allclose(color, ramp_table()[-1]) for color in colors)
    assert any(np.allclose(color, ramp_table()[len(ramp_table()) // 4 - 1], atol=0.02) for color in colors)


def test_what_sinks_into_a_floor_is_drawn_on_it():
    """3 mm deep: drawn on the ground, or the ground would hide it; 20 cm deep it has fallen through, and shows so."""
    for shape in (Box(points=(4, 4, 4)), Ball(resolution=4)):
        still = Still(Scene(jello=(shape,), collider=(Plane(),)))
        for height, lowest in ((0.497, 0.0), (0.3, -0.2)):
            drawing = drawing_at(still.put(still.body.rest + [0.0, height, 0.0]))
            drawn = drawing.skin.triangles.x[:, 1].min()
            assert lowest <= drawn + 1e-6 and drawn < lowest + 0.01
            assert drawing.points[:, 1].min() == pytest.approx(height - 0.5, abs=1e-6)
