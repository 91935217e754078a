"""Adaptive resolution of the window: as fine as recent drawing times allow."""

# (window size over picture size, antialiasing samples per side): each level has four times the samples of the last.
LEVELS = ((2, 1), (1, 1), (1, 2))
GROWTH = 4.0
SLOWEST = 1.0 / 24.0  # s, the longest acceptable drawing time
SPARE = 0.5  # of SLOWEST: switch to the finer level only if it should take less than this
PATIENCE = 1.0  # s of drawing time at a level before the next change
SMOOTHING = 0.15  # weight of the latest picture in the running mean


class Fineness:
    """level: the index in LEVELS for moving pictures. It drops when pictures take longer than SLOWEST. It rises only
    when the finer level should take less than half of SLOWEST, so that it does not oscillate."""

    def __init__(self) -> None:
        self._set(1)

    def _set(self, level: int) -> None:
        self.level, self._mean, self._spent, self._first = level, 0.0, 0.0, True

    def took(self, seconds: float) -> None:
        """Record the drawing time of a picture at this level. The first one does not count: it allocates buffers and
        may include compilation."""
        if self._first:
            self._first = False
            return
        self._mean += (seconds - self._mean) * (SMOOTHING if self._mean else 1.0)
        self._spent += seconds
        if self._spent < PATIENCE:
            return
        if self._mean > SLOWEST and self.level > 0:
            self._set(self.level - 1)
        elif GROWTH * self._mean < SPARE * SLOWEST and self.level + 1 < len(LEVELS):
            self._set(self.level + 1)
