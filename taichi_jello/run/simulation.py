"""Simulation: a running scene, its frames and substeps, snapshots, tuning and the hand."""

import contextlib
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_jello.physics.energy_ledger import Books
from taichi_jello.physics.forces.grab import MOST, Hand, Held
from taichi_jello.physics.system import System
from taichi_jello.run.assembly import assembled
from taichi_jello.run.auto_method import AUTO, Choice
from taichi_jello.run.checks import start_warnings
from taichi_jello.run.checks.watch import Watch
from taichi_jello.run.clock import Clock, StepWarning, asked_step, asked_substeps, safe_substeps, steps_in
from taichi_jello.run.diverged import diverged
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene, SceneError, vector
from taichi_jello.support import interrupt, runtime

AUTOMATIC = ("auto", None)  # dt and substeps of a step chosen by the safe step


class Simulation:
    """A scene in Taichi fields, stepped through time.

    method, and dt [s] or substeps (of a drawn frame), override the scene's solver; team forces a form of the step (see
    System); ledger: account for the work of everything that stores no energy (see energy_ledger.py); check_start: check
    that jellos do not begin through each other, needless before `restore`. Uses the running Taichi, or starts it with
    its defaults. Raises SceneError for an invalid scene, method or step, and RuntimeProblem if Taichi was restarted.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        method: str | None = None,
        dt: float | str | None = None,
        substeps: int | None = None,
        team: int | None = None,
        ledger: bool = False,
        check_start: bool = True,
    ):
        self.scene, self.frame_dt = scene, scene.solver.frame_dt
        self.asked_step = asked_step(scene.solver, dt, substeps)
        self.body: Body = assembled(scene)
        if check_start:
            start_warnings.on_crossings(scene, self.body)
            start_warnings.on_colliders(scene, self.body)
        name = method or scene.solver.method
        self.choice = Choice(scene, self.body, self.asked_step != AUTOMATIC) if name == AUTO else None
        self.system = System(scene, self.body, method=self.choice or name, team=team, ledger=ledger)
        self.method = self.system.integrator.name
        self._systems = {self.method: self.system}  # made only once, since Taichi never frees compiled code
        self._warned: tuple[Any, ...] = ()  # the unsafe step of the last warning
        self.clock = Clock(self.frame_dt, self._choose_substeps())
        self._frame_begun, self._at_start = False, True
        self._ran: set[str] = set()  # methods
        self._books: Books | None = None
        self.first_tuning, self.start = dict(self.tuning), self.snapshot()
        self._open_books()
        start_warnings.on_contact(scene, self.body)
        self.watch = Watch(scene, self.body)

    def _choose_substeps(self) -> int:
        """Substeps of a frame: as requested, or the smallest safe number. Warns once of an unsafe step, not for every
        move of a slider."""
        dt, substeps = self.asked_step
        if substeps is None and dt == "auto":
            return safe_substeps(self.system, self.method, self.frame_dt)
        chosen = asked_substeps(self.frame_dt, float(dt)) if substeps is None else substeps
        step = self.frame_dt / chosen
        if step > self.safe_dt * (1.0 + 1e-6) and self._warned != (self.method, dt, substeps):
            self._warned = self.method, dt, substeps
            message = f"dt = {step:.3g} s is beyond the largest safe step of {self.method}, {self.safe_dt:.3g} s"
            warnings.warn(message, StepWarning, stacklevel=4)
        return chosen

    @property
    def safe_dt(self) -> float:
        """The largest stable step [s] of this method; infinite if nothing oscillates."""
        return self.system.bound.dt

    @property
    def method_told(self) -> str:
        """For a method whose steps are longer than oscillations: a line that says why it was chosen and which
        frequencies it damps. Empty for others."""
        if not self.system.integrator.long_steps:
            return ""
        why = f", since {self.choice.reason}" if self.choice else ""
        fades = self.system.integrator.fades_beyond(self.dt)
        lost = f"; swings faster than {fades:.2g} Hz fade" if np.isfinite(fades) else ""
        return f"method: {self.method}{why}{lost}"

    @property
    def compiled(self) -> bool:
        """Whether this method is compiled: its first step takes longer."""
        return self.method in self._ran

    @property
    def time(self) -> float:
        """[s] since the scene's beginning."""
        return self.clock.time

    @property
    def substeps(self) -> int:
        """Of a drawn frame."""
        return self.clock.substeps

    @property
    def dt(self) -> float:
        """The substep [s]."""
        return self.clock.dt

    @property
    def x(self) -> np.ndarray:
        """(N, 3) positions [m]."""
        return self.snapshot().x

    @property
    def v(self) -> np.ndarray:
        """(N, 3) velocities [m/s]."""
        return self.snapshot().v

    def energies(self) -> dict[str, float]:
        """Kinetic, elastic, gravity (zero at y = 0) and contact energy [J]."""
        runtime.check(self.system.owner)
        self._begin_frame()
        return self.system.energies(self.clock.done * self.dt)

    @property
    def work(self) -> dict[str, float]:
        """Work [J] done on the scene since the last `restore`, by cause: changes of springs and gravity and, with a
        ledger, dashpots, friction and everything else that stores no energy. Negative where energy is lost."""
        total = dict(self.system.changes.work)
        for name, work in (self._books.works if self._books else {}).items():
            total[name] = total.get(name, 0.0) + work
        return total

    @property
    def keeps_ledger(self) -> bool:
        """Whether it was made with ledger=True."""
        return self._books is not None

    @property
    def energy_residual(self) -> float:
        """[J] The energy less that at the last `restore` and all `work` since: the error of the method, of its step and
        of rounding. Raises ValueError without a ledger."""
        if self._books is None:
            raise ValueError("the simulation keeps no ledger: make it with ledger=True")
        return self._own_energy() - sum(self._books.works.values()) - self._books.opening

    def _own_energy(self) -> float:
        """The energy [J] less the work of changes."""
        return sum(self.energies().values()) - sum(self.system.changes.work.values())

    def _open_books(self) -> None:
        ledger = self.system.ledger
        self._books = None if ledger is None else Books(self._own_energy(), ledger.names)

    @contextlib.contextmanager
    def _booked(self, name: str) -> Iterator[None]:
        """Book the energy that a call adds to the scene under `name`."""
        books, before = self._books, self._own_energy() if self._books else 0.0
        yield
        if books:
            self._books = books
            books.add({name: self._own_energy() - before})

    def frame(self) -> None:
        """Advance to the end of the current frame. Raises Diverged, back at the frame's beginning."""
        self.step(self.clock.left)

    def advance(self, seconds: float) -> None:
        """Advance by the number of substeps nearest to `seconds`."""
        if not 0.0 <= seconds < np.inf:
            raise ValueError(f"seconds: expected a finite number of at least 0, got {seconds!r}")
        self.step(steps_in(seconds, self.dt))

    def step(self, count: int = 1) -> None:
        """Advance by `count` substeps, checking for bad numbers after each frame and the last substep."""
        runtime.check(self.system.owner)
        while count > 0:
            interrupt.look()
            part = min(count, self.clock.left)
            self._begin_frame()
            self.system.steps(self.clock.done, self.clock.done + part, self.dt)
            self._ran.add(self.method)
            works = self.system.ledger.take() if self.system.ledger else {}
            bad = self.system.keep_if_finite()
            if bad is not None:
                raise diverged(self, bad, part)
            if self._books:
                self._books.add(works)
            self.clock.go_on(part)
            self._frame_begun = self.clock.done > 0
            if self._at_start and not self._frame_begun:
                self._at_start = False
                start_warnings.on_start(self.scene, self.body, self.system.read()[1])
            if not self._frame_begun and self.watch.due(self.time):
                self.watch.look(self.time, self.system.read()[0], self.system.changes.memory().get("whole"))
            count -= part

    def _begin_frame(self) -> None:
        """Pass the frame's beginning and end to the forces, once a frame."""
        if not self._frame_begun:
            clock = self.clock
            gained = self.system.begin_frame(*clock.frame, clock.done > 0, self.dt, self.asked_step == AUTOMATIC)
            if self._books and gained:
                self._books.add({"handles": gained})
            self._frame_begun = True

    def snapshot(self) -> Snapshot:
        """A copy of the current state."""
        runtime.check(self.system.owner)
        grip = None if self._hand is None else self._hand.grip
        memory = self.system.changes.memory() | self.system.integrator.remembered()
        memory |= self.system.remembered(within=self.clock.done > 0)
        return Snapshot(self.time, *self.system.read(), memory, self.clock.state, grip)

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot of the same scene; running on from it gives the same bits as before.

        Raises ValueError for another number of particles or numbers that are not finite.
        """
        runtime.check(self.system.owner)
        shape = (len(self.body), 3)
        for name in ("x", "v"):
            values = np.asarray(getattr(snapshot, name))
            if values.shape != shape:
                raise ValueError(f"{name}: expected {shape[0]} particles, shape {shape}, got shape {values.shape}")
            if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
                raise ValueError(f"{name}: expected finite numbers")
        self._at_start = snapshot is self.start
        self.system.write(snapshot.x, snapshot.v)
        self.system.changes.recall(snapshot.memory)
        self.system.integrator.recall(snapshot.memory)
        if snapshot.grip is not None and self._hand is not None:
            self._hand.grip = snapshot.grip
            self._update_grip()
        self.clock.restore(snapshot.clock, snapshot.time)
        self.system.recall(snapshot.memory)
        self._frame_begun = False
        self._open_books()

    @property
    def tuning(self) -> dict[str, Any]:
        """What `tune` can change in this scene: stiffness and damping (factors on the scene's own), gravity [m/s²],
        contact_stiffness [N/m], contact_damping [N·s/m] and friction."""
        return self.system.tuning

    def tune(self, **numbers: Any) -> None:
        """Change some of `tuning`; an automatic dt follows the new safe step. Raises ValueError for an invalid number
        or one that the scene does not have."""
        runtime.check(self.system.owner)
        before = {name: self.tuning[name] for name in numbers if name in self.tuning}
        with self._booked("tuning"):
            self.system.tune(**numbers)
        try:
            self._choose_step()
        except SceneError as error:
            self.system.tune(**before)
            raise ValueError(error.problem) from None

    def change_method(self, name: str) -> None:
        """Continue with another method. Raises SceneError if it is unknown or has no safe step."""
        now, tuning, before, books = self.snapshot(), self.tuning, (self.system, self.method), self._books
        if name not in self._systems:
            self._systems[name] = System(self.scene, self.body, method=name, ledger=before[0].ledger is not None)
        self.system, self.method, self.choice = self._systems[name], name, None
        try:
            self.system.tune(**tuning)
            self._choose_step()
        except SceneError:
            self.system, self.method = before
            raise
        self.restore(now)
        self._books = books

    def change_step(self, *, dt: float | str | None = None, substeps: int | None = None) -> None:
        """Change dt [s] ("auto" too) or the substeps of the following frames, as in the constructor."""
        runtime.check(self.system.owner)
        self.asked_step = asked_step(self.scene.solver, dt, substeps)
        self._choose_step()

    def _choose_step(self) -> None:
        """Begin a new frame if the number of substeps changes."""
        self.clock.cut(self._choose_substeps())
        self._frame_begun = False

    @property
    def _hand(self) -> Hand | None:
        return next((force for force in self.system.all_forces if isinstance(force, Hand)), None)

    def _need_hand(self) -> Hand:
        if self._hand is None:
            raise ValueError("the scene has no Grab() among its forces")
        self._frame_begun = False  # the hand's new place counts from the frame that begins now
        return self._hand

    def _update_grip(self) -> None:
        """Choose the step anew: the hand's spring limits it while it holds something."""
        self.system.find_bound()
        self._choose_step()

    def grab(self, particles: Any, weights: Any, target: Any) -> None:
        """Pull the point Σ weights x of 1 to 24 particles to `target` (3,) [m] from now on. Raises ValueError if the
        scene has no Grab() force or for invalid arguments."""
        who, share, place = np.asarray(particles, int), np.asarray(weights, float), vector("target", target)
        if not 1 <= who.size <= MOST or np.any(who < 0) or np.any(who >= len(self.body)):
            raise ValueError(f"particles: expected 1 to {MOST} from 0 to {len(self.body) - 1}, got {who.tolist()}")
        if share.shape != who.shape or np.any(share < -1e-6) or not abs(share.sum() - 1.0) < 1e-3:
            raise ValueError(f"weights: expected {who.size} that sum to 1, got {share.tolist()}")
        self._need_hand().take(who, np.maximum(share, 0.0), place)
        self._update_grip()

    def move_grab(self, target: Any) -> None:
        """Move the hand to `target` (3,) [m] during the next frame."""
        self._need_hand().target = np.array(vector("target", target))

    def release(self) -> None:
        """Let go."""
        self._need_hand().let_go()
        self._update_grip()

    def push(self, velocity: Any, jello: int | None = None) -> None:
        """Add `velocity` (3,) [m/s] to all free particles, or to those of one jello."""
        kick, now = np.array(vector("velocity", velocity)), self.snapshot()
        moved = ~self.body.pinned & (True if jello is None else self.body.jello == jello)
        with self._booked("pushes"):
            self.restore(replace(now, v=now.v + moved[:, None] * kick))

    @property
    def held(self) -> Held | None:
        """What the hand holds, and how hard it pulls."""
        return self._hand.now(*self.system.read()) if self._hand is not None and self._hand.holds else None

    def reset(self) -> None:
        """Return to the beginning."""
        self.restore(self.start)

    def render(self, size: tuple[int, int] = (1280, 720), **options: Any) -> np.ndarray:
        """A picture (height, width, 3) uint8 of the current state; options as for `taichi_jello.view.picture`."""
        from taichi_jello.view import picture

        return picture(self, size, **options)
