"""Recorded play: what a person did to a simulation, frame by frame, in a small file, and the same again to the bit.

The file holds one JSON object a line: first what was played, then every call with the number of frames before it.
"""

import hashlib
import json
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, TextIO

import numpy as np

from taichi_jello import __version__
from taichi_jello.physics.forces.grab import with_hand
from taichi_jello.physics.forces.wind import with_wind
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.description import Camera, Scene
from taichi_jello.support.wording import counted

FORMAT = 2
BUDGET = 200e6  # bytes of moments that a replay keeps to go back to
BEAT = 60  # frames after which the file says how long the play is so far
# What of a Simulation changes how it goes on. A test looks that every public method is either here or changes nothing.
CALLS = ("grab", "move_grab", "release", "push", "tune", "change_method", "change_step", "reset")


class ReplayError(ValueError):
    """A file that is no recorded play, or one of another scene or of other settings."""


class ReplayOver(Exception):
    """The repeated play has no frame more; the next one begins a new run."""


def playable(scene: Scene) -> Scene:
    """The scene with what a person needs to play with it, a hand and wind, unless it has them."""
    return with_wind(with_hand(scene))


def _plainly(value: Any) -> Any:
    """The same text for the same scene in any process: without defaults, so that a key that is new changes no scene
    that does not use it."""
    if is_dataclass(value):
        own = {f.name: getattr(value, f.name) for f in fields(value)}
        default = {f.name: f.default for f in fields(value)}
        told = {name: _plainly(part) for name, part in own.items() if _plainly(part) != _plainly(default[name])}
        return [type(value).__name__, told]
    if isinstance(value, dict):
        return {str(key): _plainly(part) for key, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plainly(part) for part in value]
    if isinstance(value, np.ndarray):
        return [value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    if callable(value):
        return getattr(value, "__qualname__", type(value).__name__)
    return repr(value)


def fingerprint(scene: Scene) -> str:
    """Short and different for scenes that differ in anything but their camera, length and title."""
    plain = replace(scene, camera=Camera(), seconds=0.0, title="")
    return hashlib.sha256(json.dumps(_plainly(plain)).encode()).hexdigest()[:16]


def header(simulation: Simulation) -> dict[str, Any]:
    """What must be the same for a replay to give the same bits."""
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


def _plain(value: Any) -> Any:
    return np.asarray(value).tolist() if not isinstance(value, (str, dict)) else value


class Recorded:
    """A simulation whose frames are counted and whose CALLS are written to a file as they are made; else the same.

    Every line is whole when it is written, so that a play that is killed can still be replayed up to there."""

    def __init__(self, simulation: Simulation, path: Path):
        self.simulation, self.frames, self.path = simulation, 0, path
        self._file: TextIO = path.open("w", encoding="utf-8")
        self._write(header(simulation))

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.simulation, name)
        if name not in CALLS:
            return found

        def call(*arguments: Any, **named: Any) -> Any:
            done = found(*arguments, **named)  # a call that is refused leaves no trace
            packed = {key: _plain(value) for key, value in named.items()}
            self._write({"frame": self.frames, "call": name, "with": [_plain(a) for a in arguments], "named": packed})
            return done

        return call

    def frame(self) -> None:
        self.simulation.frame()
        self.frames += 1
        if self.frames % BEAT == 0:
            self._end()

    def _end(self) -> None:
        self._write({"frame": self.frames, "call": "end"})

    def close(self) -> str:
        """Note how long the play was, and tell it. Nothing is recorded after that."""
        if not self._file.closed:
            self._end()
            self._file.close()
        return f"{self.path}: {counted(self.frames, 'frame')} recorded"


def _refused(name: str) -> NoReturn:
    """NaN and Infinity, which JSON itself does not know."""
    raise ValueError(name)


class Replay:
    """The calls of a recorded play, to be made again on a simulation of the same scene and settings.

    Raises ReplayError, naming the line, for a file that is no recorded play."""

    def __init__(self, path: Path):
        lines = path.read_text(encoding="utf-8").splitlines()
        try:
            self.header = json.loads(lines[0])
            known = self.header["jello_play"] == FORMAT
        except (IndexError, ValueError, KeyError, TypeError):
            raise ReplayError(f"{path}: expected a recorded play of `jello play --log`") from None
        if not known:
            raise ReplayError(f"{path}: expected format {FORMAT}, got {self.header['jello_play']}; record it again")
        self.path = path
        self.calls = [self._call(number, line) for number, line in enumerate(lines[1:], 2)]
        self.frames = max((call["frame"] for call in self.calls), default=0)

    def _call(self, number: int, line: str) -> dict[str, Any]:
        try:
            call = json.loads(line, parse_constant=_refused) | {"line": number}
            if isinstance(call["frame"], int) and call["call"] in (*CALLS, "end"):
                return {"with": [], "named": {}} | call
        except (ValueError, KeyError, TypeError):
            pass
        raise ReplayError(f"{self.path}: line {number}: expected a call of a recorded play, with finite numbers")

    def check(self, simulation: Simulation) -> None:
        """Raise ReplayError if the simulation is not the one that was played."""
        for name, mine in header(simulation).items():
            if self.header.get(name) != mine:
                told = "another scene" if name == "scene" else f"{name} {self.header.get(name)!r}, this is {mine!r}"
                raise ReplayError(f"{self.path}: was played with {told}")


@dataclass(frozen=True)
class Moment:
    """All that a play has changed of a simulation until then."""

    snapshot: Snapshot
    method: str
    asked: tuple[float | str, int | None]  # dt and substeps
    tuning: dict[str, Any]
    calls: int

    @classmethod
    def of(cls, simulation: Simulation, calls: int) -> "Moment":
        return cls(simulation.snapshot(), simulation.method, simulation.asked_step, simulation.tuning, calls)

    @property
    def bytes(self) -> int:
        kept = (self.snapshot.x, self.snapshot.v, *self.snapshot.memory.values())
        return sum(values.nbytes for values in kept)

    def back_to(self, simulation: Simulation) -> int:
        """Bring the simulation there; the number of calls that were made before."""
        if simulation.method != self.method:
            simulation.change_method(self.method)
        dt, substeps = self.asked
        simulation.change_step(dt=dt if substeps is None else None, substeps=substeps)
        simulation.tune(**self.tuning)
        simulation.restore(self.snapshot)
        return self.calls


class Replayed:
    """A simulation, just made, whose frames repeat a recorded play; else the same. One of the CALLS made by somebody
    else ends the repeating: from there it is a new run. Raises ReplayError if the play was of another simulation."""

    def __init__(self, simulation: Simulation, replay: Replay):
        replay.check(simulation)
        self.simulation, self.length = simulation, replay.frames
        self.frames, self.repeating, self.path = 0, True, replay.path
        self._calls = sorted(replay.calls, key=lambda call: call["frame"])
        self._next = 0  # of the calls
        self._kept: dict[int, Moment] = {}
        self._every = 1  # frames between two kept moments
        self._told = False  # that it is over

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.simulation, name)
        if name not in CALLS:
            return found

        def call(*arguments: Any, **named: Any) -> Any:
            if self.repeating and self.simulation.held is not None:
                self.simulation.release()  # the recorded hand is not that of the person who takes over
            self.repeating = False
            return found(*arguments, **named)

        return call

    def frame(self) -> None:
        """The next frame. Raises ReplayOver once where the play ends; who goes on from there begins a new run."""
        if self.repeating and self.frames >= self.length:
            if not self._told:
                self._told = True
                raise ReplayOver
            self.repeating = False
        if self.repeating:
            self._keep()
            self._make_calls()
        self.simulation.frame()
        self.frames += 1

    def _make_calls(self) -> None:
        """What was done before the frame that follows."""
        while self._next < len(self._calls) and self._calls[self._next]["frame"] <= self.frames:
            call = self._calls[self._next]
            self._next += 1
            if call["call"] != "end":
                try:
                    getattr(self.simulation, call["call"])(*call["with"], **call["named"])
                except (ValueError, TypeError, IndexError) as error:
                    raise ReplayError(f"{self.path}: line {call['line']}: {call['call']}: {error}") from None

    def _keep(self) -> None:
        """Keep this moment for scrub; every second one goes when they outgrow BUDGET."""
        if self.frames % self._every or self.frames in self._kept:
            return
        self._kept[self.frames] = Moment.of(self.simulation, self._next)
        if len(self._kept) * self._kept[self.frames].bytes > BUDGET:
            self._every *= 2
            self._kept = {frame: moment for frame, moment in self._kept.items() if frame % self._every == 0}

    def scrub(self, frames: int) -> None:
        """Go forth, or back, by so many frames of the play: from the nearest kept moment before."""
        wanted = min(max(self.frames + frames, 0), self.length)
        if wanted < self.frames:
            self.frames = max(frame for frame in self._kept if frame <= wanted)
            self._next = self._kept[self.frames].back_to(self.simulation)
            self._told = False
        while self.frames < wanted:
            self.frame()

    @property
    def time(self) -> float:
        """[s] of the play, also where the play set the simulation's own clock back."""
        return self.frames * self.dt

    @property
    def dt(self) -> float:
        """[s] A replay steps by whole frames."""
        return float(self.simulation.frame_dt)

    def step(self, count: int = 1) -> None:
        """Go on by so many frames, but not beyond the play's end."""
        for _ in range(min(count, self.length - self.frames)):
            self.frame()

    def advance(self, seconds: float) -> None:
        self.step(round(seconds / self.dt))
