"""Errors in a user's own code, named by its file and line."""


def test_own_code_that_fails_while_a_scene_runs_is_one_line(here, tmp_path):
    """Python code of the scene and of a file beside it, and code that Taichi compiles at the first step."""
    helper = "def path(t):\n  return 1 / (0 if 0.1 < t < 0.2 else 1)\ndef flat(p, s):\n  return p + q\n"
    (tmp_path / "beside.py").write_text(helper)
    begin = "import sys; sys.path.insert(0, '.')\nimport beside, taichi as ti\nfrom taichi_jello import *\n"
    begin += "class Own(Sphere):\n  type = 'own'\n"
    own = "Own(center=(0, -9, 0), velocity=(0, 1, 0))"
    end = f"\ndef scene(): return Scene(jello=[Box(points=(2, 2, 2))], collider=[{own}])\n"
    for body, where, words in (
        ("  def origin(self, t):\n    if 0.1 < t < 0.2: raise ValueError('gone\\nfar')\n    return super().origin(t)",
         "own.py: line 7", "ValueError: gone"),
        ("  def origin(self, t):\n    beside.path(t)\n    return super().origin(t)",
         f"{tmp_path / 'beside.py'}: line 2", "ZeroDivisionError: division by zero"),
        ("  signed_distance = staticmethod(ti.func(beside.flat))",
         f"{tmp_path / 'beside.py'}: line 4", 'TaichiNameError: Name "q" is not defined'),
    ):  # fmt: skip
        (tmp_path / "own.py").write_text(begin + body + end)
        done = here("run", "own.py", "-o", "x.npz", "--seconds", "0.2")
        assert done.returncode == 2 and done.stderr == f"jello: {where}: it fails with {words}\n"
