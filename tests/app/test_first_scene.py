"""The first scene of the README, and pictures without a jello."""

import re
from pathlib import Path

import numpy as np
from PIL import Image

README = Path(__file__).parents[2] / "README.md"


def picture(path):
    return np.array(Image.open(path)).astype(int)


def test_the_first_scene_of_the_readme_shows_its_jello(here, tmp_path):
    scene = re.search(r"```toml\n(.*?)```", README.read_text(encoding="utf-8"), re.S)[1]
    assert len(scene.splitlines()) <= 8
    (tmp_path / "hello.toml").write_text(scene)
    done = here("shot", "hello.toml", "-o", "x.png", "--at", "0.5", "--size", "320x180", "--renderer", "raster")
    assert done.returncode == 0 and not done.stderr
    colors = picture(tmp_path / "x.png")
    jello = np.ptp(colors, axis=2) > 60  # sky, ground and shadows are greyer
    assert jello[60:120, 107:213].mean() > 0.2
    assert not jello[:30].any()  # the sky


def test_a_picture_without_a_jello_is_told(here, tmp_path):
    (tmp_path / "away.toml").write_text('[camera]\neye = [9, 9, 9]\ntarget = [19, 19, 19]\n[[jello]]\nshape = "box"')
    done = here("shot", "away.toml", "-o", "x.png", "--size", "160x90", "--renderer", "raster")
    assert done.returncode == 0
    assert done.stderr == (
        "jello: warning: no jello is in the picture: see camera.eye and camera.target, or leave both out\n"
    )
