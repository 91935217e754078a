"""Colours as a person writes them, and the camera's way in time."""

import numpy as np
import pytest

from taichi_jello import Background, Box, Camera, CameraKeyframe, Ground, Plane, Region, Scene, SceneError, scenefiles
from taichi_jello.scene.colors import color
from taichi_jello.scene.keyframes import smooth

BOX = '[[jello]]\nshape = "box"\npoints = [2, 2, 2]\n'


@pytest.mark.parametrize(
    ("value", "rgb"),
    [
        ("tomato", (255, 99, 71)),
        ("RebeccaPurple", (102, 51, 153)),
        ("#0a80FF", (10, 128, 255)),
        ([0.0, 0.2, 1.0], (0, 51, 255)),
        (np.array([1, 0, 0]), (255, 0, 0)),
    ],
)
def test_a_color_is_a_name_or_digits_or_three_numbers(value, rgb):
    assert np.array(color("color", value)) * 255.0 == pytest.approx(rgb)
    assert Box(color=value).color == color("color", value)


@pytest.mark.parametrize("value", ["strawbery", "#12345", "123456", "#1234567", "", [0.1], [0, 0, 1.1], [0, -1, 0], 3])
def test_what_is_no_color_is_told_in_one_line(value):
    with pytest.raises(SceneError) as told:
        color("jello.0.color", value)
    assert str(told.value).startswith('jello.0.color: expected a CSS name such as "tomato", "#rrggbb" or three numbers')
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (BOX + 'color = "jelly"', "line 4: jello.0.color: expected a CSS name"),
        (BOX + "[[jello.region]]\ncolor = [1, 2, 3]", "line 5: jello.0.region.0.color: expected a CSS name"),
        ('[[collider]]\ntype = "plane"\ncolor = 1\n' + BOX, "line 3: collider.0.color: expected a CSS name"),
        ('[ground]\npattern = "dots"\n' + BOX, "line 2: ground.pattern: expected one of checker, plain, got 'dots'"),
        ("[ground]\nshow = 1\n" + BOX, "line 2: ground.show: expected true or false"),
        ("[background]\ntop = []\n" + BOX, "line 2: background.top: expected a CSS name"),
        ("[camera]\nfollow = 1\n" + BOX, "line 2: camera.follow: expected a jello, 0 to 0, got 1"),
        ("[camera]\nscale = 0\n" + BOX, "line 2: camera.scale: expected a finite number greater than 0"),
        ("[[camera.keyframe]]\nfov = 9\n" + BOX, "camera.keyframe.0: expected time too"),
        ("[[camera.keyframe]]\ntime = 1\nfov = 200\n" + BOX, "camera.keyframe.0.fov: expected less than 180"),
    ],
)
def test_a_wrong_look_names_file_line_and_key(text, told, tmp_path):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(SceneError) as error:
        scenefiles.load(str(tmp_path / "scene.toml"))
    assert str(error.value).startswith(f"{tmp_path / 'scene.toml'}: ") and told in str(error.value)


def test_looks_are_written_and_read_back(tmp_path):
    way = [CameraKeyframe(time=0.0, fov=50.0), CameraKeyframe(time=2.0, eye=(1.0, 2.0, 3.0))]
    scene = Scene(
        jello=[Box(color="gold", region=[Region(max=(1.0, 0.5, 1.0), color="#ff0000")])],
        collider=[Plane(color=(0.1, 0.2, 0.3))],
        camera=Camera(keyframe=way, follow=0, orbit=-0.25, scale=3.0),
        ground=Ground(color="wheat", pattern="plain", show=False),
        background=Background(top="black"),
    )
    scenefiles.save(scene, str(tmp_path / "scene.toml"))
    assert scenefiles.load(str(tmp_path / "scene.toml")) == scene


def test_the_camera_s_way_meets_its_keyframes_and_goes_not_beyond_them():
    times, heights = np.array([0.0, 1.0, 1.5, 4.0, 5.0]), np.array([1.0, 2.0, 2.0, 7.0, 3.0])
    rows = [CameraKeyframe(time=t, target=(0.0, h, 0.0)) for t, h in zip(times, heights, strict=True)]
    at = lambda time: smooth(rows, "target", (9.0, 9.0, 9.0), time)[1]  # noqa: E731
    assert [at(t) for t in (-1.0, *times, 9.0)] == pytest.approx([1.0, *heights, 3.0])
    way = np.array([at(t) for t in np.linspace(0.0, 5.0, 2001)])
    for k in range(4):
        part = way[(np.linspace(0.0, 5.0, 2001) >= times[k]) & (np.linspace(0.0, 5.0, 2001) <= times[k + 1])]
        steps = np.diff(part) * np.sign(heights[k + 1] - heights[k] or 1.0)
        assert steps.min() > -1e-12
    # No kink: the rate of change is continuous, and zero at both ends. 4 cm a frame of 2.5 ms would be a kink.
    rate = np.diff(way) / 0.0025
    assert np.abs(np.diff(rate)).max() < 0.06 and max(abs(rate[0]), abs(rate[-1])) < 0.06
    assert smooth(rows, "eye", (9.0, 8.0, 7.0), 1.0) == pytest.approx((9.0, 8.0, 7.0))
