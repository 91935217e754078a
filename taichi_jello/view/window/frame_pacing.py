"""Physics in step with the clock: as many frames as the clock asks for and the machine can do in time."""

import time
from typing import Any

MOST_FRAMES = 8  # physics frames for one drawn one: a slow machine slows time instead of freezing the window
BUDGET = 0.012  # s of physics for one drawn frame, or
SHARE = 0.5  # of the time that a drawn frame takes, where drawing is what is slow


class Pace:
    """`scale`: simulated seconds wanted for a second of the clock; `speed`: what they lately were; `cost`: seconds of
    the machine's that a physics frame lately took."""

    def __init__(self) -> None:
        self.scale, self.speed, self.cost = 1.0, 1.0, 0.0
        self._owed = 0.0

    def rest(self) -> None:
        """Owe nothing for the time that passes."""
        self._owed = 0.0

    def advance(self, simulation: Any, seconds: float) -> int:
        """Let `seconds` of the clock pass: whole physics frames follow. Returns how many."""
        frame = simulation.frame_dt
        self._owed += self.scale * seconds
        wanted = int(self._owed / frame + 1e-9)
        budget = max(BUDGET, SHARE * min(seconds, 0.1))
        frames, spent = 0, 0.0
        while frames < min(wanted, MOST_FRAMES) and spent < budget:
            spent += self.frame(simulation)
            frames += 1
        # Time that a slow machine cannot make up is forgotten, not saved for a burst.
        self._owed = self._owed - frames * frame if frames == wanted else 0.0
        self.speed += (frames * frame / seconds - self.speed) * min(1.0, seconds)
        return frames

    def exactly(self, simulation: Any, seconds: float) -> int:
        """As many whole physics frames as make up `seconds`, however long that takes. Returns how many."""
        self.rest()
        frames = max(1, round(self.scale * seconds / simulation.frame_dt))
        for _ in range(frames):
            self.frame(simulation)
        return frames

    def frame(self, simulation: Any) -> float:
        """One physics frame; how long it took [s]."""
        start = time.perf_counter()
        simulation.frame()
        spent = time.perf_counter() - start
        self.cost += (spent - self.cost) * (0.2 if self.cost else 1.0)
        return spent
