"""Regions: which springs they hold, what they make of them, and every mistake."""

import numpy as np
import pytest

from taichi_jello import Box, Pin, Region, Scene, SceneError
from taichi_jello.run.assembly import assembled, built

CUBE = {"points": (5, 5, 5), "stiffness": 100.0, "damping": 1.0}


def middles(body):
    """(S, 3) the springs' middles, 0 to 1 along each axis of a 1 m cube."""
    return body.rest[body.springs].mean(1) + 0.5


def test_a_pin_that_holds_no_point_is_a_mistake():
    with pytest.raises(SceneError, match=r"pin.1: expected a box in the body"):
        built(Box(points=(3, 3, 3), pin=[Pin(), Pin(min=(0.1, 0.1, 0.1), max=(0.4, 0.4, 0.4))]))


def test_a_box_and_a_ball_hold_the_springs_whose_middle_is_inside():
    body = built(
        Box(region=[Region(max=(1, 0.5, 1), stiffness=800), Region(center=(1, 1, 1), radius=0.3, damping=2)], **CUBE)
    )
    middle = middles(body)
    assert np.array_equal(body.stiffness == 800.0, middle[:, 1] <= 0.5 + 1e-9)
    near = np.linalg.norm(middle - 1.0, axis=1) <= 0.3
    assert near.any() and np.array_equal(body.damping == 2.0, near)
    assert set(body.stiffness) == {100.0, 800.0} and set(body.damping) == {1.0, 2.0}


def test_a_later_region_goes_over_an_earlier_one_and_families_may_differ():
    first, second = Region(stiffness=300.0), Region(stiffness={"shear": 7.0}, stiffness_factor=2.0)
    body = built(Box(region=[first, second], **CUBE))
    assert np.array_equal(body.stiffness, np.where(body.family == 1, 14.0, 600.0))


def test_a_painted_grid_is_linear_between_its_nodes_and_a_function_sees_the_places():
    nodes = np.linspace([0.0, 1.0, 2.0], [1.0, 3.0, 7.0], 2)  # of the x, y and z parts
    grid = nodes[:, None, None, 0] + nodes[None, :, None, 1] + nodes[None, None, :, 2]
    painted = built(Box(region=[Region(stiffness_factor=grid)], **CUBE))
    called = built(Box(region=[Region(stiffness_factor=lambda p: 3 + p @ [1, 2, 5])], **CUBE))
    expected = 100.0 * (3.0 + middles(painted) @ [1.0, 2.0, 5.0])
    assert painted.stiffness == pytest.approx(expected) and called.stiffness == pytest.approx(expected)
    flat = built(Box(region=[Region(max=(1, 1, 0.5), damping_factor=[[[3.0]]])], **CUBE))
    assert np.array_equal(flat.damping, np.where(middles(flat)[:, 2] <= 0.5 + 1e-9, 3.0, 1.0))


@pytest.mark.parametrize(
    "region, words",
    [
        ({"min": (2, 2, 2), "max": (3, 3, 3)}, "jello.1.region.0: expected a part of the body"),
        ({"center": (5, 0, 0), "radius": 0.5}, "jello.1.region.0: expected a part of the body"),
        ({"stiffness_factor": lambda p: -1.0}, "jello.1.region.0.stiffness_factor: expected a function that gives"),
        (
            {"stiffness_factor": lambda p: "a"},
            "jello.1.region.0.stiffness_factor: the function of places failed",
        ),
        ({"mass_factor": lambda p: 1 / 0}, "jello.1.region.0.mass_factor: the function of places failed: ZeroDivision"),
        ({"stiffness_factor": lambda p: p}, "jello.1.region.0.stiffness_factor: expected a function of"),
    ],
)
def test_mistakes_that_only_the_body_shows(region, words):
    with pytest.raises(SceneError) as caught:
        assembled(Scene(jello=[Box(), Box(points=(3, 3, 3), region=[Region(**region)])]))
    assert str(caught.value).startswith(words)


@pytest.mark.parametrize(
    "region, words",
    [
        ({"min": (0, 1, 0), "max": (1, 0, 1)}, "max: expected at least min"),
        ({"radius": 0.0}, "radius: expected a finite number greater than 0"),
        ({"center": (0.5, 0.5, 0.5)}, "center: expected a radius beside it"),
        ({"stiffness": -1.0}, "stiffness: expected a finite number of at least 0"),
        ({"damping_factor": [[1.0, 2.0]]}, "damping_factor: expected x by y by z numbers"),
        ({"stiffness_factor": [[[True]]]}, "stiffness_factor: expected a number or nested lists"),
        ({"stiffness_factor": [[["soft"]]]}, "stiffness_factor: expected a number or nested lists"),
        ({"stiffness_factor": [[[-1.0]]]}, "stiffness_factor: expected finite numbers of at least 0"),
    ],
)
def test_mistakes_in_the_description(region, words):
    with pytest.raises(SceneError) as caught:
        Region(**region)
    assert str(caught.value).startswith(words)


def test_lists_of_parts_are_checked():
    with pytest.raises(SceneError, match=r"region.1: expected a Region, got 3"):
        Box(region=[Region(), 3])
    with pytest.raises(SceneError, match="region: expected a list of Region"):
        Box(region="soft")


def test_points_inside_weigh_more():
    """A box, a painted grid and a function; a region may hold a single point and no spring."""
    body = built(Box(region=[Region(max=(1, 0.5, 1), mass_factor=10.0)], **CUBE))
    below = body.rest[:, 1] <= 1e-9
    assert body.mass == pytest.approx(np.where(below, 10.0, 1.0) / len(body))
    ramp = built(Box(region=[Region(mass_factor=[[[1.0]], [[3.0]]])], **CUBE))
    called = built(Box(region=[Region(mass_factor=lambda p: 1.0 + 2.0 * p[:, 0])], **CUBE))
    assert ramp.mass == pytest.approx((2.0 + 2.0 * ramp.rest[:, 0]) / len(body)) == called.mass
    corner = built(Box(region=[Region(max=(0, 0, 0), mass_factor=1e4)], **CUBE))
    assert corner.mass.max() == pytest.approx(1e4 / len(body)) and (corner.mass > 1.0 / len(body)).sum() == 1


@pytest.mark.parametrize("factor", [0.0, lambda p: p[:, 0], [[[1.0, 0.0]]]])
def test_no_point_is_without_mass(factor):
    with pytest.raises(SceneError, match="mass_factor: expected factors above 0"):
        built(Box(region=[Region(mass_factor=factor)], **CUBE))
