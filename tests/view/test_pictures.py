"""What is seen, in both renderers."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from still import Still, cube_scene

from taichi_jello.physics.colliders.sphere import Sphere
from taichi_jello.scene.description import Scene
from taichi_jello.shapes.lattice import Box
from taichi_jello.view.drawing.drawing import LAYERS
from taichi_jello.view.render import ggui
from taichi_jello.view.render.renderers import drawing_of, film_strip, finished, open_renderer

SIZE = (480, 270)
RENDERERS = [
    "raster",
    pytest.param("ggui", marks=pytest.mark.skipif(not ggui.available(), reason="no Vulkan driver works here")),
]


@contextmanager
def opened(name: str, samples: int = 1):
    renderer = open_renderer(name, SIZE, samples)
    try:
        yield renderer
    finally:
        renderer.close()


def shot(name, simulation, *, color="force", only=LAYERS, samples=1, legend=False, renderer=None):
    """A picture with only some layers, as int."""
    drawing = drawing_of(simulation)
    drawing.hidden = set(LAYERS) - set(only)
    options = {"color": color, "legend": legend}
    if renderer is not None:
        return finished(renderer, drawing, simulation, **options).astype(int)
    with opened(name, samples) as renderer:
        return finished(renderer, drawing, simulation, **options).astype(int)


def reddish(image):
    return (image[..., 0] - image[..., 1] > 60) & (image[..., 0] - image[..., 2] > 40)


def bluish(image):
    return (image[..., 2] - image[..., 0] > 80) & (image[..., 2] - image[..., 1] > 60)


def box(mask):
    rows, columns = np.nonzero(mask)
    return np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])


@pytest.mark.parametrize("name", RENDERERS)
def test_skin_is_where_the_camera_says(name, cube):
    image, empty = shot(name, cube, only=("skin",)), shot(name, cube, only=())
    assert image.shape == (SIZE[1], SIZE[0], 3)
    corners = drawing_of(cube).viewpoint.project(cube.body.x, SIZE)
    expected = np.concatenate([corners.min(0), corners.max(0)])
    assert np.abs(box(np.abs(image - empty).max(2) > 2) - expected).max() < 2.0
    assert reddish(image).sum() > 0.5 * np.prod(expected[2:] - expected[:2])


@pytest.mark.parametrize("name", RENDERERS)
def test_dots_are_where_the_camera_says(name):
    scene = Scene(jello=(Box(points=(1, 1, 1), position=(0.45, 0.9, 0.2)),), camera=cube_scene().camera)
    simulation = Still(scene)
    # One particle has no springs, hence the plain radius of 2 cm; without colliders nothing else is drawn.
    image = shot(name, simulation, only=("particles",), samples=2)
    ink = 255.0 * 3 - image.sum(2)
    ink = np.where(ink > ink.min() + 150.0, ink, 0.0)
    y, x = np.indices(ink.shape) + 0.5
    found = np.array([(ink * x).sum(), (ink * y).sum()]) / ink.sum()
    expected = drawing_of(simulation).viewpoint.project(np.array([[0.45, 0.9, 0.2]]), SIZE)[0]
    assert np.linalg.norm(found - expected) < 1.0


@pytest.mark.parametrize("name", RENDERERS)
def test_springs_are_blue_at_rest_and_red_when_stretched(name, cube):
    with opened(name) as renderer:
        rest = shot(name, cube, only=("springs",), renderer=renderer)
        assert bluish(rest).sum() > 300 and not reddish(rest).any()
        pulled = cube.body.x.copy()
        corner = np.argmax(pulled @ [1.0, 1.0, 1.0])
        pulled[corner] += 0.5
        stretched = shot(name, cube.put(pulled), only=("springs",), renderer=renderer)
    near = drawing_of(cube).viewpoint.project(pulled[corner : corner + 1], SIZE)[0]
    rows, columns = np.nonzero(reddish(stretched))
    # The springs that hold the corner end there; the far ones keep their length and their colour.
    assert np.hypot(columns - near[0], rows - near[1]).min() < 4.0
    assert bluish(stretched).sum() > 200


@pytest.mark.parametrize("name", RENDERERS)
def test_families_have_their_colors(name, cube):
    image = shot(name, cube, color="family", only=("springs",))
    orange = (image[..., 0] - image[..., 2] > 120) & (image[..., 1] - image[..., 2] > 40)
    assert bluish(image).sum() > 60 and orange.sum() > 200


@pytest.mark.parametrize("name", RENDERERS)
def test_shadow_pales_and_moves_with_height(name):
    darkest, middle = [], []
    with opened(name) as renderer:
        for height in (0.8, 1.6):
            simulation = Still(cube_scene(height, points=2))
            drawing = drawing_of(simulation)
            drawing.hidden = set(LAYERS)
            shaded = finished(renderer, drawing, simulation, legend=False).astype(int)
            simulation.put(simulation.body.x + [0.0, 1e3, 0.0])
            lost = finished(renderer, drawing, simulation, legend=False).astype(int) - shaded
            assert np.mean(lost < -1) < 1e-3  # a shadow brightens nothing
            darkest.append(lost.max())
            middle.append(box(lost.max(2) > 0.5 * lost.max()).reshape(2, 2).mean(0)[0])
    # The sun stands to the left: a higher cube throws a paler shadow farther to the right.
    assert 20 < darkest[1] < darkest[0] - 5
    assert middle[0] + 4.0 < middle[1]


@pytest.mark.parametrize("name", RENDERERS)
def test_legend_shows_the_ramp_and_more_ink(name, cube):
    with opened(name) as renderer:
        bare = shot(name, cube, renderer=renderer)
        with_legend = shot(name, cube, legend=True, renderer=renderer)
    corner = np.s_[220:, :120]
    assert bluish(with_legend[corner]).any() and reddish(with_legend[corner]).any()
    assert not reddish(bare[corner]).any()
    assert (with_legend[240:, 400:] != bare[240:, 400:]).sum() > 100  # the time


@pytest.mark.parametrize("samples", [1, 2])
def test_raster_repeats_itself_to_the_bit(samples, cube):
    first = shot("raster", cube, samples=samples)
    assert all(np.array_equal(first, shot("raster", cube, samples=samples)) for _ in range(3))


@pytest.mark.parametrize("samples", [1, 2])
def test_what_is_kept_from_picture_to_picture_is_never_old(samples):
    """Several pictures of rest, after which the eye, the jello or a collider moves: each as one drawn afresh."""
    moving = Sphere(center=(0.9, 0.4, 0.3), radius=0.4, velocity=(0.0, 3.0, 0.0))
    scene = cube_scene(0.9)
    simulation = Still(replace(scene, collider=(*scene.collider, moving)))
    drawing = drawing_of(simulation)
    start = drawing.viewpoint.eye.copy()
    with opened("raster", samples) as renderer, opened("raster", samples) as fresh:
        for time, right, up in ((0.0, 0.0, 0.0),) * 3 + ((0.0, 0.5, 0.0),) * 3 + ((0.1, 0.5, 0.0), (0.1, 0.5, 0.2)):
            simulation.time, drawing.viewpoint.eye[:] = time, start + [right, 0.0, 0.0]
            simulation.put(simulation.body.x + [0.0, up, 0.0])
            kept = finished(renderer, drawing, simulation)
            anew = drawing_of(simulation)
            anew.viewpoint.eye[:] = drawing.viewpoint.eye
            assert np.array_equal(kept, finished(fresh, anew, simulation))


@pytest.mark.skipif(not ggui.available(), reason="no Vulkan driver works here")
def test_both_renderers_draw_springs_in_the_same_places():
    simulation = Still(cube_scene(0.9, rotation=(20.0, 30.0, 10.0)))
    ours, theirs = (shot(name, simulation, only=("springs",)) for name in ("raster", "ggui"))
    assert np.abs(box(bluish(ours)) - box(bluish(theirs))).max() <= 2


def test_more_samples_soften_edges(cube):
    """From pixel to pixel the picture of a cube's outline and of what is seen through it changes less."""
    rough, soft = (shot("raster", cube, only=("skin",), samples=samples) for samples in (1, 2))
    steps = [np.square(np.diff(image, axis=1)).sum() for image in (rough, soft)]
    assert steps[1] < 0.97 * steps[0]


@pytest.mark.parametrize("name", RENDERERS)
def test_a_camera_inside_the_scene_draws(name, cube):
    """Floor and springs reach behind the eye: no stray pixel of theirs in the upper, empty half of the
    picture."""
    drawing = drawing_of(cube)
    drawing.hidden = {"skin", "particles"}
    drawing.viewpoint.eye[:] = [0.0, 1.2, 0.4]
    drawing.viewpoint.target[:] = [0.0, 1.3, -5.0]
    with opened(name) as renderer:
        image = finished(renderer, drawing, cube, legend=False).astype(int)
        drawing.hidden = set(LAYERS)
        assert np.abs(image - finished(renderer, drawing, cube, legend=False))[:60].max() <= 1
    assert np.median(image[200:, :, 2] - image[200:, :, 0]) < 16


def test_a_film_strip_shows_the_scene_from_beginning_to_end():
    simulation = Still(replace(cube_scene(points=2), seconds=0.5))
    strip = film_strip(simulation, (480, 270), "raster").astype(int)
    assert strip.shape == (270, 480, 3) and simulation.time == pytest.approx(0.5, abs=1 / 60)
    tops = [box(reddish(tile))[1] for row in np.split(strip[:270], 2) for tile in np.split(row, 2, axis=1)]
    assert tops == sorted(tops, reverse=True) and tops[0] > tops[1]  # it rises 5 cm a frame


@pytest.mark.parametrize("name", RENDERERS)
def test_of_a_larger_picture_before_nothing_is_left(name):
    small, large = (Still(cube_scene(0.9, points=points)) for points in (4, 9))
    afresh = shot(name, small)
    with opened(name) as renderer:
        for simulation in (large, small, large, large):
            shot(name, simulation, renderer=renderer)
        assert np.array_equal(shot(name, small, renderer=renderer), afresh)


@pytest.mark.parametrize("name", RENDERERS)
def test_a_picture_of_what_is_no_number_spoils_none_after_it(name, cube):
    """What the driver's memory held before is no part of a picture."""
    afresh = shot(name, cube)
    with opened(name) as renderer:
        for points in (4, 5, 6, 7) * 10:
            broken = Still(cube_scene(points=points))
            shot(name, broken.put(np.full_like(broken.x, np.nan)), renderer=renderer)
            assert np.array_equal(shot(name, cube, renderer=renderer), afresh)
