"""Physics in step with the clock: as many frames as the clock asks for and the machine can do in time."""

import time

from taichi_jello.view.render.renderers import Run

MAX_FRAMES_PER_DRAW = 8  # a slow machine slows time instead of freezing the window
BUDGET = 0.012  # s of physics for one drawn frame, or
BUDGET_SHARE = 0.5  # of the time that a drawn frame takes, if drawing is slow


class Pace:
    """scale: wanted simulated seconds per second; speed: the recent ones; cost: recent seconds per physics frame."""

    def __init__(self) -> None:
        self.scale, self.speed, self.cost = 1.0, 1.0, 0.0
        self._owed = 0.0

    def rest(self) -> None:
        """Forget the time that has passed."""
        self._owed = 0.0

    def in_real_time(self) -> None:
        """End slow motion, and forget the time that has passed."""
        self.scale = 1.0
        self.rest()

    def advance(self, simulation: Run, seconds: float) -> int:
        """Make the whole physics frames for `seconds` of the clock. Returns how many."""
        frame_dt = simulation.frame_dt
        self._owed += self.scale * seconds
        wanted = int(self._owed / frame_dt + 1e-9)
        budget = max(BUDGET, BUDGET_SHARE * min(seconds, 0.1))
        frames, spent = 0, 0.0
        while frames < min(wanted, MAX_FRAMES_PER_DRAW) and spent < budget:
            spent += self.frame(simulation)
            frames += 1
        # What a slow machine cannot make up is forgotten, not saved for a burst.
        self._owed = self._owed - frames * frame_dt if frames == wanted else 0.0
        self.speed += (frames * frame_dt / seconds - self.speed) * min(1.0, seconds)
        return frames

    def exactly(self, simulation: Run, seconds: float) -> int:
        """Make the whole physics frames for `seconds`, however long it takes. Returns how many."""
        self.rest()
        frames = max(1, round(self.scale * seconds / simulation.frame_dt))
        for _ in range(frames):
            self.frame(simulation)
        return frames

    def frame(self, simulation: Run) -> float:
        """Make one physics frame. Returns how long it took [s]."""
        start = time.perf_counter()
        simulation.frame()
        spent = time.perf_counter() - start
        self.cost += (spent - self.cost) * (0.2 if self.cost else 1.0)
        return spent
