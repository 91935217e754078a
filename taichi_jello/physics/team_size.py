"""How many threads of a team share the work, by measured time.

Threads that spin lose more than they win where something else runs on their cores: each waits for the slowest. Since
every number of threads gives the same bits, the clock may choose it.
"""

from dataclasses import dataclass

WINDOW = 0.04  # s of work that the usual pace is measured over
PORTION, LONG = 0.02, 0.1  # s of one launch, by a team and by one thread, which waits for nobody
SHORT = 0.004  # s of one launch while another number is tried
SLOW = 1.3  # times the best pace: then fewer threads are worth a trial
GAIN = 0.95  # of the usual pace: then the other number is better
PATIENCE = 0.01  # s that a trial may lose
TRIALS = {-1: 0.05, 1: 0.3}  # s of a trial of fewer threads and of more
SOONEST, LATEST = 0.2, 5.0  # s of work between trials in vain
SHARE, RAREST = 0.03, 60.0  # of all time, that trials in vain may cost, and the longest wait for that [s]


def sizes(largest: int) -> list[int]:
    """All teams that are tried, the smallest first: one less than all, and halves."""
    return sorted({max(1, largest - 1)} | {largest >> k for k in range(max(1, largest).bit_length())})


@dataclass
class Span:
    """Seconds that some work took, in any unit that is the same for all teams."""

    seconds: float = 0.0
    work: float = 0.0

    def add(self, seconds: float, work: float) -> None:
        self.seconds, self.work = self.seconds + seconds, self.work + work

    def fade(self) -> None:
        """Let the past weigh no more than half of WINDOW."""
        part = min(1.0, 0.5 * WINDOW / self.seconds)
        self.seconds, self.work = part * self.seconds, part * self.work

    @property
    def pace(self) -> float:
        return self.seconds / self.work


class TeamSize:
    """`members` of at most `largest` threads share the next launch. `took` reports how long each launch took: the only
    clock here. Fewer threads are tried where the pace has become slow, and once where a new number begins; more now
    and then, ever more rarely while that is in vain. A trial ends as soon as it has lost PATIENCE."""

    def __init__(self, largest: int):
        self.sizes, self.members, self.held = sizes(largest), largest, False
        self.home, self.time = largest, 0.0  # the best number as far as known; s of work until now
        self.substep = 0.0  # s, of late
        self.recent, self.best, self.compared = Span(), float("inf"), False
        self.away, self.trial, self.lost = 0, Span(), 0.0
        self.wait, self.due = {-1: SOONEST, 1: SOONEST}, {-1: 0.0, 1: 0.0}

    def hold(self, members: int) -> None:
        """Fix the number of threads."""
        self.members, self.held = min(members, self.sizes[-1]), True

    def portion(self, left: int) -> int:
        """How many of `left` substeps the next launch is to do."""
        if self.held:
            return left
        if self.substep == 0.0:
            return 1
        wanted = SHORT if self.members != self.home else PORTION if self.members > 1 else LONG
        return min(left, max(1, int(wanted / self.substep)))

    def took(self, substeps: int, work: float, seconds: float) -> None:
        """Report the last launch: its substeps, its work in all and its time."""
        if self.held or substeps < 1 or work <= 0.0:
            return
        self.time += seconds
        if self.members == self.home:
            self.substep = seconds / substeps
            self.recent.add(seconds, work)
            if self.recent.seconds > WINDOW:
                self._stay_or_try()
        else:
            self.trial.add(seconds, work)
            self.lost = max(self.lost + seconds - self.recent.pace * work, -PATIENCE)
            self._judge()

    def _stay_or_try(self) -> None:
        self.best = min(self.best, self.recent.pace)
        slow = self.recent.pace > SLOW * self.best or not self.compared
        for way, wanted in ((-1, slow), (1, True)):
            if wanted and self.time >= self.due[way] and self._try(way):
                return
        self.recent.fade()

    def _try(self, places: int) -> bool:
        """Let the next launch be of a team so many places beyond the usual one among `sizes`, if there is one."""
        place = self.sizes.index(self.home) + places
        if not 0 <= place < len(self.sizes):
            return False
        self.members, self.away, self.trial, self.lost = self.sizes[place], places, Span(), 0.0
        return True

    def _judge(self) -> None:
        """End the trial if it has lost too much, or if it was long enough."""
        way = 1 if self.away > 0 else -1
        ends = self.trial.seconds > TRIALS[way]
        if self.lost > PATIENCE or (ends and self.trial.pace > GAIN * self.recent.pace):
            self._go_back(way)
        elif ends:
            self.home, self.best, self.compared = self.members, self.trial.pace, False
            self.recent = Span()
            self.wait[way] = max(0.5 * self.wait[way], SOONEST)
            self.due = {way: self.time, -way: self.time + self.wait[-way]}

    def _go_back(self, way: int) -> None:
        lost = max(0.0, self.trial.seconds - self.recent.pace * self.trial.work)
        self.wait[way] = max(min(2.0 * self.wait[way], LATEST), min(lost / SHARE, RAREST))
        self.due[way] = self.time + self.wait[way]
        if way < 0:
            if self._try(self.away - 1):
                return
            self.best, self.compared = self.recent.pace, True  # the team is not what makes it slow
        self.members = self.home
        self.recent.fade()
