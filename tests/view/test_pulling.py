"""A real jello on the mouse: it comes to rest under the cursor, and no motion breaks it."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_jello import Box, Camera, Contact, Plane, Scene, Simulation, Sphere
from taichi_jello.run.replay import playable
from taichi_jello.view.window import play as loop
from taichi_jello.view.window.viewer import Viewer


def opened(scene, size=(1280, 720)):
    simulation = Simulation(playable(scene))
    simulation.frame()  # compiled once; the window says so meanwhile
    simulation.reset()
    viewer = Viewer(simulation)
    viewer.size = size
    return viewer


def front(viewer):
    """Where the particle nearest to the eye is on the screen, and a little inside."""
    view, x = viewer.viewpoint, viewer.simulation.x
    nearest = np.argmin(np.linalg.norm(x - view.eye, axis=1))
    inside = 0.9 * x[nearest] + 0.1 * x.mean(0)
    return view.project(inside[None], viewer.size)[0]


def test_dragged_to_a_corner_it_rests_within_3_pixels_of_the_cursor():
    """A soft free jello under gravity, in windows of both shapes, taken across the window in a third of a second."""
    cube = Box(points=(5, 5, 5), position=(0.0, 0.6, 0.0), stiffness=50.0, damping=0.05)
    viewer = opened(Scene(jello=[cube]))
    for viewer.size in ((1280, 720), (800, 1000)):
        viewer.simulation.reset()
        width, height = viewer.size
        at = front(viewer)
        viewer.press("left", tuple(at))
        assert viewer.grabbed is not None
        for corner in ((8.0, 8.0), (width - 8.0, 8.0), (8.0, height - 8.0), (width - 8.0, height - 8.0)):
            way = np.array(corner) - at
            for k in range(1, 21):
                viewer.move(tuple(at + way * k / 20.0))
                viewer.step()
            at = np.array(corner)
            for _ in range(120):
                viewer.step()
            held = viewer.simulation.held
            point, target = viewer.viewpoint.project(np.stack([held.point, held.target]), viewer.size)
            assert target == pytest.approx(at, abs=1e-3)
            assert np.linalg.norm(point - at) < 3.0
        viewer.release("left")


def test_two_jellos_are_grabbed_in_turn_also_while_paused():
    """One cube is pulled aside, then the other; the one that is not held stays where it is."""
    cubes = [Box(points=(3, 3, 3), size=(0.6, 0.6, 0.6), position=(x, 0.4, 0.0)) for x in (-0.6, 0.6)]
    viewer = opened(Scene(jello=cubes, gravity=(0.0, 0.0, 0.0), contact=Contact(touch=False)))
    simulation = viewer.simulation
    for jello, way in ((0, -150.0), (1, 150.0)):
        own = simulation.body.jello == jello
        at = viewer.viewpoint.project(simulation.x[own].mean(0)[None], viewer.size)[0]
        before = simulation.x
        viewer.handle_key(" ")
        viewer.press("left", tuple(at))
        assert set(simulation.body.jello[list(simulation.held.particles)]) == {jello}
        viewer.move((at[0] + way, at[1]))
        assert viewer.advance(0.1) == 0 and np.array_equal(simulation.x, before)
        viewer.handle_key(" ")
        for _ in range(90):
            viewer.step()
        moved = (simulation.x - before)[:, 0]
        assert moved[own].mean() * np.sign(way) > 0.15 and abs(moved[~own].mean()) < 0.1
        viewer.release("left")
        viewer.step()


@pytest.mark.parametrize("stiffness", [1.0, 200.0, 1e5])
def test_no_motion_of_the_mouse_breaks_a_jello(stiffness, anew):
    """Every frame another place up to metres away, now and then towards the eye or away from it; let go and grabbed
    again; on the floor, against a sphere and in the air. Numbers that are not finite would pause the window."""
    cube = Box(points=(4, 4, 4), position=(0.0, 0.7, 0.0), stiffness=stiffness)
    anew()
    viewer = opened(Scene(jello=[cube], collider=[Plane(), Sphere(center=(0.7, 0.2, 0.0), radius=0.4)]))
    person, grabs, held = np.random.default_rng(7), 0, 0
    for frame in range(360):
        if viewer.grabbed is None and frame % 4 == 0:
            if np.abs(viewer.simulation.x).max() > 50.0:
                viewer.handle_key("r")
            viewer.handle_key("f")
            viewer.press("left", tuple(front(viewer)))
            grabs += viewer.grabbed is not None
        elif person.random() < 0.04:
            viewer.release("left")
        viewer.move(tuple(person.uniform((-2000.0, -2000.0), (3000.0, 3000.0))), in_depth=person.random() < 0.2)
        viewer.step()
        held += viewer.grabbed is not None
        assert not viewer.paused, viewer.notice
        assert np.isfinite(viewer.simulation.x).all() and np.isfinite(viewer.simulation.v).all()
    assert grabs >= 5 and held > 150


class Watched:
    """In place of the window: each call of `listen` puts the cursor at the next place of a path, each `show` notes
    where the held point is in the picture that would be drawn then [pixels]."""

    def __init__(self, path):
        self.path, self.seen = path, []

    def __call__(self, size, title, keep, renderer):
        self.size = size
        return self

    @property
    def running(self):
        return len(self.seen) < len(self.path)

    def listen(self, viewer):
        viewer.size, at = self.size, tuple(self.path[len(self.seen)])
        if not self.seen:
            viewer.press("left", at)
            assert viewer.grabbed is not None
        viewer.move(at)

    def show(self, viewer):
        if viewer.simulation.held is None:  # the first picture, before anything is pressed
            return
        self.seen.append(viewer.viewpoint.project(viewer.simulation.held.point[None], viewer.size)[0])

    def write_alone(self, viewer, words):
        pass

    def forget_keys(self):
        pass

    def close(self):
        pass


def test_the_held_point_is_drawn_where_the_cursor_was_when_the_frame_began(monkeypatch):
    """Drawn across at 10 pixels a frame, 600 a second, from the first frame on it is near the cursor of that same
    frame. One frame of delay would be 10 pixels."""
    still, moving = 20, 20
    path = np.array([320.0, 180.0]) + np.zeros((still + moving, 1))
    path[still:, 0] += 10.0 * np.arange(1, moving + 1)
    watched, clock = Watched(path), iter(np.arange(1000) / 60.0 * (1.0 + 1e-9))
    monkeypatch.setattr(loop, "Screen", watched)
    monkeypatch.setattr(loop, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    jello = Box(points=(5, 5, 5), stiffness=50.0, damping=0.05, position=(0.0, 0.5, 0.0))
    scene = Scene(jello=[jello], camera=Camera(eye=(0.0, 0.5, 4.0), target=(0.0, 0.5, 0.0)))
    loop.play(Simulation(playable(scene)), size=(640, 360))
    behind = np.linalg.norm(path - np.array(watched.seen), axis=1)[still:]
    assert behind.max() < 5.0, behind
