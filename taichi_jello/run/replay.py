"""Recorded play: the calls made to a simulation, by frame, in a small file, and their exact repetition.

The file holds one JSON object a line: first a header of what was played, then every call with its frame.
"""

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from taichi_jello import __version__
from taichi_jello.physics.forces.grab import with_hand
from taichi_jello.physics.forces.wind import with_wind
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.description import Scene
from taichi_jello.scene.look import Background, Camera, Ground
from taichi_jello.scene.validation import shown
from taichi_jello.support.wording import counted

FORMAT = 2
BUDGET = 200e6  # bytes of states that a replay keeps to go back to
END_INTERVAL = 60  # frames between notes of the length so far
# The methods that change how a Simulation continues. A test checks that no public method is missing.
CALLS = ("grab", "move_grab", "release", "push", "tune", "change_method", "change_step", "reset")


class ReplayError(ValueError):
    """A file that is not a recorded play, or one of another scene or other settings."""


class ReplayOver(Exception):
    """The repeated play has ended; the next frame begins a new run."""


def playable(scene: Scene) -> Scene:
    """The scene with a hand and wind to play with."""
    return with_wind(with_hand(scene))


def _canonical(value: Any) -> Any:
    """The same JSON value for the same scene in any process. Defaults are left out, so a new key changes only the
    scenes that use it."""
    if is_dataclass(value):
        pairs = {f.name: (_canonical(getattr(value, f.name)), _canonical(f.default)) for f in fields(value)}
        return [type(value).__name__, {name: own for name, (own, default) in pairs.items() if own != default}]
    if isinstance(value, dict):
        return {str(key): _canonical(part) for key, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [_canonical(part) for part in value]
    if isinstance(value, np.ndarray):
        return [value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    if callable(value):
        return getattr(value, "__qualname__", type(value).__name__)
    return repr(value)


def fingerprint(scene: Scene) -> str:
    """A hash of everything in the scene but its camera, ground, background, length and title."""
    plain = replace(scene, camera=Camera(), ground=Ground(), background=Background(), seconds=0.0, title="")
    return hashlib.sha256(json.dumps(_canonical(plain)).encode()).hexdigest()[:16]


def header(simulation: Simulation) -> dict[str, Any]:
    """What must match for a replay to give the same bits."""
    owner = simulation.system.owner
    return {
        "jello_play": FORMAT,
        "version": __version__,
        "scene": fingerprint(simulation.scene),
        "method": simulation.method,
        "substeps": simulation.substeps,
        "precision": owner.precision,
        "arch": owner.arch,
    }


class Watched(ABC):
    """A simulation whose CALLS pass through `_call`, and whose frames are counted; otherwise the same."""

    def __init__(self, simulation: Simulation, path: Path):
        self.simulation, self.path, self.frames = simulation, path, 0

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.simulation, name)
        return partial(self._call, found) if name in CALLS else found

    @abstractmethod
    def _call(self, method: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        """Make one of the CALLS."""


class Recorded(Watched):
    """A simulation whose CALLS are written to a file as they are made: a play that is killed can be replayed up to
    there."""

    def __init__(self, simulation: Simulation, path: Path):
        super().__init__(simulation, path)
        self._file = path.open("w", encoding="utf-8")
        self._write(header(simulation))

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line, default=lambda array: np.asarray(array).tolist()) + "\n")
        self._file.flush()

    def _call(self, method: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        done = method(*arguments, **named)  # calls that raise are not recorded
        self._write({"frame": self.frames, "call": method.__name__, "with": arguments, "named": named})
        return done

    def frame(self) -> None:
        self.simulation.frame()
        self.frames += 1
        if self.frames % END_INTERVAL == 0:
            self._write({"frame": self.frames, "call": "end"})

    def close(self) -> str:
        """End the recording. Returns a line on its length."""
        if not self._file.closed:
            self._write({"frame": self.frames, "call": "end"})
            self._file.close()
        return f"{self.path}: {counted(self.frames, 'frame')} recorded"


def _refuse(name: str) -> NoReturn:
    """For NaN and Infinity, which Python's reader accepts although JSON has neither."""
    raise ValueError(name)


class Replay:
    """The calls of a recorded play, in order.

    Raises ReplayError, naming the line, for a file that is not a recorded play."""

    def __init__(self, path: Path):
        lines = path.read_text(encoding="utf-8").splitlines()
        try:
            self.header = json.loads(lines[0])
            version = self.header["jello_play"]
        except (IndexError, ValueError, KeyError, TypeError, RecursionError):
            raise ReplayError(f"{path}: expected a recorded play of `jello play --log`") from None
        if version != FORMAT:
            raise ReplayError(f"{path}: expected format {FORMAT}, got {shown(version)}; record it again")
        self.path = path
        calls = [self._read(number, line) for number, line in enumerate(lines[1:], 2)]
        self.calls = sorted(calls, key=lambda call: call["frame"])
        self.frames = self.calls[-1]["frame"] if calls else 0

    def _read(self, number: int, line: str) -> dict[str, Any]:
        try:
            call = json.loads(line, parse_constant=_refuse) | {"line": number}
            if isinstance(call["frame"], int) and call["call"] in (*CALLS, "end"):
                return {"with": [], "named": {}} | call
        except (ValueError, KeyError, TypeError, RecursionError):
            pass
        raise ReplayError(f"{self.path}: line {number}: expected a call of a recorded play, with finite numbers")

    def check(self, simulation: Simulation) -> None:
        """Raise ReplayError if the simulation is not the one that was played."""
        for name, mine in header(simulation).items():
            if self.header.get(name) != mine:
                played = shown(self.header.get(name))
                other = "another scene" if name == "scene" else f"{name} {played}, this is {mine!r}"
                raise ReplayError(f"{self.path}: was played with {other}")


@dataclass(frozen=True)
class Moment:
    """Everything that a play may have changed in a simulation, and the number of calls until then."""

    snapshot: Snapshot
    method: str
    step: tuple[float | str, int | None]  # dt and substeps
    tuning: dict[str, Any]
    calls: int

    @property
    def bytes(self) -> int:
        return sum(a.nbytes for a in (self.snapshot.x, self.snapshot.v, *self.snapshot.memory.values()))

    def restore(self, simulation: Simulation) -> None:
        if simulation.method != self.method:
            simulation.change_method(self.method)
        dt, substeps = self.step
        simulation.change_step(dt=dt if substeps is None else None, substeps=substeps)
        simulation.tune(**self.tuning)
        simulation.restore(self.snapshot)


class Replayed(Watched):
    """A new simulation whose frames repeat a recorded play. One of the CALLS from outside ends that and begins a new
    run. Raises ReplayError if the play was of another simulation."""

    def __init__(self, simulation: Simulation, replay: Replay):
        replay.check(simulation)
        super().__init__(simulation, replay.path)
        self.length, self.repeating = replay.frames, True
        self._calls, self._next = replay.calls, 0
        self._kept: dict[int, Moment] = {}
        self._interval = 1  # frames between kept moments
        self._over = False  # ReplayOver was raised

    def _call(self, method: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        if self.repeating and self.simulation.held is not None:
            self.simulation.release()  # the recorded grip
        self.repeating = False
        return method(*arguments, **named)

    def frame(self) -> None:
        """The next frame. Raises ReplayOver once at the end of the play; a further frame begins a new run."""
        if self.repeating and self.frames >= self.length:
            if not self._over:
                self._over = True
                raise ReplayOver
            self.repeating = False
        if self.repeating:
            self._keep()
            self._make_calls()
        self.simulation.frame()
        self.frames += 1

    def _make_calls(self) -> None:
        """Make the calls recorded before the next frame."""
        while self._next < len(self._calls) and self._calls[self._next]["frame"] <= self.frames:
            call = self._calls[self._next]
            self._next += 1
            if call["call"] != "end":
                try:
                    getattr(self.simulation, call["call"])(*call["with"], **call["named"])
                except (ValueError, TypeError, IndexError) as error:
                    raise ReplayError(f"{self.path}: line {call['line']}: {call['call']}: {error}") from None

    def _keep(self) -> None:
        """Keep this moment for scrub; drop every second one when they exceed BUDGET."""
        if self.frames % self._interval or self.frames in self._kept:
            return
        now = self.simulation
        moment = Moment(now.snapshot(), now.method, now.asked_step, now.tuning, self._next)
        self._kept[self.frames] = moment
        if len(self._kept) * moment.bytes > BUDGET:
            self._interval *= 2
            self._kept = {frame: kept for frame, kept in self._kept.items() if frame % self._interval == 0}

    def scrub(self, frames: int) -> None:
        """Move forward, or back, by `frames` of the play: from the nearest kept moment before."""
        target = min(max(self.frames + frames, 0), self.length)
        if target < self.frames:
            self.frames = max(frame for frame in self._kept if frame <= target)
            self._kept[self.frames].restore(self.simulation)
            self._next, self._over = self._kept[self.frames].calls, False
        while self.frames < target:
            self.frame()

    @property
    def time(self) -> float:
        """[s] in the play, even if the play set the simulation's own clock back."""
        return self.frames * self.dt

    @property
    def dt(self) -> float:
        """[s] A replay steps by whole frames."""
        return float(self.simulation.frame_dt)

    def step(self, count: int = 1) -> None:
        """Advance by `count` frames, not beyond the play's end."""
        for _ in range(min(count, self.length - self.frames)):
            self.frame()

    def advance(self, seconds: float) -> None:
        self.step(round(seconds / self.dt))
