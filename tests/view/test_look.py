"""Light as the rasteriser computes it, checked on shapes whose light is known."""

import numpy as np
import pytest
from still import Still, cube_scene

from taichi_jello.scene.description import Camera, Scene
from taichi_jello.shapes.ball import Ball
from taichi_jello.shapes.lattice import Box
from taichi_jello.view.drawing.palette import GAMMA
from taichi_jello.view.render.pixels import buffers, develop, strokes
from taichi_jello.view.render.pixels.studio import INDEX, LOW, NADIR
from taichi_jello.view.render.raster import Raster
from taichi_jello.view.render.renderers import drawing_of, finished

SIZE = (320, 180)
RADIUS = 0.5  # m
DISTANCE = 4.0  # m


@pytest.fixture(scope="module")
def ball():
    scene = Scene(
        jello=(Ball(resolution=12, radius=RADIUS),),
        camera=Camera(eye=(0.0, 0.0, DISTANCE), target=(0.0, 0.0, 0.0), show="skin"),
    )
    return Still(scene)


def radiance(simulation, absorption, glow):
    """(height, width, 3) linear, of a body that absorbs and scatters so."""
    renderer, drawing = Raster(SIZE, samples=1), drawing_of(simulation)
    finished(renderer, drawing, simulation, legend=False)
    for gel in renderer._gels.gel:
        gel[0], gel[1] = absorption, glow
    finished(renderer, drawing, simulation, legend=False)
    return renderer._stages[0].scene.copy()


def test_light_through_the_middle_of_a_ball_is_absorbed_by_its_way(ball):
    middle = SIZE[1] // 2, SIZE[0] // 2
    clear, dark = (radiance(ball, absorption, 0.0)[middle] for absorption in (0.0, 1e4))
    absorption = np.array([0.2, 1.0, 2.5])
    left = (radiance(ball, absorption, 0.0)[middle] - dark) / (clear - dark)
    assert left == pytest.approx(np.exp(-absorption * 2.0 * RADIUS), rel=0.05)


def test_the_rim_reflects_as_schlick_says(ball):
    """Of a black ball only reflections of the sky are seen, more towards its rim."""
    picture = radiance(ball, 1e4, 0.0)
    row, focal = SIZE[1] // 2, drawing_of(ball).viewpoint.pixels_per_meter(SIZE[1])
    zenith, horizon = (np.array(color) ** GAMMA for color in (ball.scene.background.top, ball.scene.background.bottom))
    outline = RADIUS / np.sqrt(DISTANCE**2 - RADIUS**2) * focal
    found, expected = [], []
    for column in np.linspace(SIZE[0] / 2 + 0.4 * outline, SIZE[0] / 2 + 0.93 * outline, 12).astype(int):
        d = np.array([column + 0.5 - SIZE[0] / 2, SIZE[1] / 2 - row - 0.5, -focal])
        d /= np.linalg.norm(d)
        along = -d[2] * DISTANCE - np.sqrt((d[2] * DISTANCE) ** 2 - DISTANCE**2 + RADIUS**2)
        n = (np.array([0.0, 0.0, DISTANCE]) + along * d) / RADIUS
        facing = -(d @ n)
        bounce = d + 2.0 * facing * n
        base = ((INDEX - 1.0) / (INDEX + 1.0)) ** 2
        high = zenith if bounce[1] > 0.0 else NADIR * horizon
        t = np.clip(abs(bounce[1]) / 0.6, 0.0, 1.0)
        share = bounce[1] * (1.0 + LOW) / (bounce[1] + LOW) if bounce[1] > 0.0 else t * t * (3.0 - 2.0 * t)
        sky = horizon + (high - horizon) * share
        expected.append((base + (1.0 - base) * (1.0 - facing) ** 5) * sky)
        found.append(picture[row, column])
    assert np.array(found) == pytest.approx(np.array(expected), rel=0.12, abs=2e-3)
    assert found[-1][1] > 3.0 * found[0][1]


def test_the_backdrop_has_no_bands():
    """From row to row its mean changes by less than a level, and no row is all of one level."""
    simulation = Still(Scene(jello=(Box(points=(1, 1, 1)),), camera=Camera(show="skin")))
    renderer, drawing = Raster(SIZE, samples=1), drawing_of(simulation)
    drawing.hidden = {"skin", "springs", "particles"}
    image = finished(renderer, drawing, simulation, legend=False).astype(float)
    assert np.abs(np.diff(image.mean(1), axis=0)).max() < 1.0
    assert image.std(1).max() < 1.5 and np.ptp(image[: SIZE[1] // 2, :, 0].mean(1)) > 2.0


@pytest.mark.parametrize("radius", [0.6, 1.1, 2.5])
@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 90.0])
def test_a_stroke_covers_as_much_as_it_is_wide(radius, angle):
    """Over black and over white: what of their difference is lost is covered."""
    view = np.zeros((9, 3), np.float32)
    view[4:7], view[8, 0] = np.eye(3), 100.0  # columns, rows and depth are x, y and z at a depth of 1 m
    way = 20.0 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    middle = np.array([32.3, 31.6, 1.0])
    x = np.array([middle - way, middle + way], np.float32)
    keys, box = np.zeros((64, 64), np.int64), np.array([[0, 0], [64, 64]], np.int32)
    ends, thick = np.zeros((1, 8), np.float32), np.array([[radius / 100.0, 1e3]], np.float32)
    strokes.strokes(view, x, np.array([[0, 1]], np.int32), thick, ends, keys, box)
    far, seen = np.full((64, 64), buffers.FAR, np.float32), []
    for shade in (0.0, 0.5):
        scene, mean = np.full((64, 64, 3), shade, np.float32), np.zeros((64, 64, 3), np.float32)
        image, rgb = np.zeros((64, 64), np.uint32), np.full((1, 3), 0.5, np.float32)
        table = develop.srgb_table()
        develop.compose(keys, ends, rgb, 0.0, scene, far, far, box, mean, -1.0, image, table, 0)
        seen.append(mean)
    covered = 1.0 - (seen[1] - seen[0])[..., 0] / 0.5
    assert covered.sum() == pytest.approx(2.0 * radius * 40.0 + np.pi * radius**2, rel=0.1)


def test_a_jello_before_another_is_drawn_over_it():
    """The nearer cube's colour wins where both are, whichever is named first."""
    for order in (1, -1):
        boxes = tuple(Box(points=(3, 3, 3), position=(0.0, 0.6, z)) for z in (1.2, -1.2)[::order])
        simulation = Still(Scene(jello=boxes, camera=cube_scene().camera))
        renderer, drawing = Raster(SIZE, samples=1), drawing_of(simulation)
        drawing.hidden = {"springs", "particles"}
        image = finished(renderer, drawing, simulation, legend=False).astype(int)
        center = image[SIZE[1] // 2, SIZE[0] // 2]
        near = 0 if order == 1 else 1
        assert (center[0] > center[1]) == (near == 0)


def test_thickness_has_no_seams():
    """The counts of a closed body's depths cancel outside it, and inside they are its thickness to a thousandth."""
    simulation = Still(cube_scene(1.0, rotation=(20.0, 30.0, 10.0)))
    renderer, drawing = Raster(SIZE, samples=1), drawing_of(simulation)
    finished(renderer, drawing, simulation, legend=False)
    thick, front, back = renderer._thick * buffers.UNIT, renderer._front, renderer._back
    seen = (front < buffers.EMPTY) & (back >= 0)
    assert seen.sum() > 1000 and np.array_equal(seen, front < buffers.EMPTY)
    depth = [(keys[seen] >> 32).astype(np.int32).view(np.float32) for keys in (front, back)]
    assert thick[seen] == pytest.approx(depth[1] - depth[0], abs=1e-3)
