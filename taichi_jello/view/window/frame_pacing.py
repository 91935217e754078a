"""Keep the simulation in real time: run as many physics frames as are due and the machine can compute in time."""

import time

from taichi_jello.view.render.renderers import Run

MAX_FRAMES_PER_DRAW = 8  # on a slow machine simulated time slows down instead of freezing the window
BUDGET = 0.012  # s of physics per drawn frame, or
BUDGET_SHARE = 0.5  # of the time of a drawn frame, if drawing is slow


class Pace:
    """scale: requested simulated seconds per second; speed: those recently achieved; cost: recent seconds of computing
    per physics frame."""

    def __init__(self) -> None:
        self.scale, self.speed, self.cost = 1.0, 1.0, 0.0
        self._owed = 0.0

    def rest(self) -> None:
        """Drop the time owed to the simulation."""
        self._owed = 0.0

    def in_real_time(self) -> None:
        """Return to real time, and drop the time owed to the simulation."""
        self.scale = 1.0
        self.rest()

    def advance(self, simulation: Run, seconds: float) -> int:
        """Run the physics frames due after `seconds` of real time, whole ones only. Returns how many."""
        frame_dt = simulation.frame_dt
        self._owed += self.scale * seconds
        wanted = int(self._owed / frame_dt + 1e-9)
        budget = max(BUDGET, BUDGET_SHARE * min(seconds, 0.1))
        frames, spent = 0, 0.0
        while frames < min(wanted, MAX_FRAMES_PER_DRAW) and spent < budget:
            spent += self.frame(simulation)
            frames += 1
        # A backlog that a slow machine cannot work off is dropped, so that no burst follows.
        self._owed = self._owed - frames * frame_dt if frames == wanted else 0.0
        self.speed += (frames * frame_dt / seconds - self.speed) * min(1.0, seconds)
        return frames

    def exactly(self, simulation: Run, seconds: float) -> int:
        """Run the physics frames for `seconds`, however long that takes. Returns how many."""
        self.rest()
        frames = max(1, round(self.scale * seconds / simulation.frame_dt))
        for _ in range(frames):
            self.frame(simulation)
        return frames

    def frame(self, simulation: Run) -> float:
        """Run one physics frame. Returns how long it took [s]."""
        start = time.perf_counter()
        simulation.frame()
        spent = time.perf_counter() - start
        self.cost += (spent - self.cost) * (0.2 if self.cost else 1.0)
        return spent
