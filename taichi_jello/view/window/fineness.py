"""How finely the window's pictures are drawn: as finely as the time that the last ones took allows."""

# (a side of the window over that of the drawn picture, samples): each has four times the samples of the one before.
LEVELS = ((2, 1), (1, 1), (1, 2))
GROWTH = 4.0
SLOWEST = 1.0 / 24.0  # s that a picture may take
SPARE = 0.5  # of SLOWEST, that the finer level may be expected to take
PATIENCE = 1.0  # s of drawing at a level before the next change
SMOOTHING = 0.15  # weight of the last picture in the mean


class Fineness:
    """level: of LEVELS, for pictures of something that moves. It falls when pictures take longer than SLOWEST, and
    rises only when the finer ones are expected to take half as long: so it does not go to and fro."""

    def __init__(self) -> None:
        self._set(1)

    def _set(self, level: int) -> None:
        self.level, self._mean, self._spent, self._first = level, 0.0, 0.0, True

    def took(self, seconds: float) -> None:
        """A picture at this level was drawn in that time. The first one does not count: it fills new buffers, and may
        have been compiled."""
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
