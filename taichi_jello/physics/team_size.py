"""How many threads of a team share the work, by the time that it takes.

Threads that spin for each other lose more than they win where something else runs on their cores: each waits for the
one that does not run. As every number of them gives the same bits, the number may follow the clock.
"""

from dataclasses import dataclass

WINDOW = 0.04  # s of work that tell the usual pace
PORTION = 0.02  # s that one launch lasts about, of which the next may be of fewer threads
SHORT = 0.004  # s, while another number is tried
LONG = 0.1  # s, of one thread, which waits for nobody
SLOW = 1.3  # times as long as it took at best: fewer threads are worth a trial
GAIN = 0.95  # of the time that it took before: the other number is the better one
PATIENCE = 0.01  # s that a trial may lose
TRIALS = {-1: 0.05, 1: 0.3}  # s of a trial of fewer threads and of more, which may do well until the other runs again
SOONEST, LATEST = 0.2, 5.0  # s of work between trials that are in vain
SHARE, RAREST = 0.03, 60.0  # of all time, that these may cost, until they are so rare [s]


def sizes(most: int) -> list[int]:
    """All teams that are tried, the smallest first: one less than all, and halves."""
    found = {most, max(1, most - 1)}
    while most > 1:
        most //= 2
        found.add(most)
    return sorted(found)


@dataclass
class Span:
    """Seconds that some work took, in any unit that is the same for all teams."""

    seconds: float = 0.0
    work: float = 0.0

    def add(self, seconds: float, work: float) -> None:
        self.seconds, self.work = self.seconds + seconds, self.work + work

    def fade(self) -> None:
        """Let all that is past count for no more than half of WINDOW."""
        part = min(1.0, 0.5 * WINDOW / self.seconds)
        self.seconds, self.work = part * self.seconds, part * self.work

    @property
    def pace(self) -> float:
        return self.seconds / self.work


class TeamSize:
    """`members` of at most `most` threads share the next launch. Told how long each launch took, it tries fewer where
    they have become slow, and once where it begins with a number; and more now and then, ever more rarely as long as
    that is in vain. A trial is short, and ends as soon as it has lost PATIENCE. Its only clock is the time that it is
    told."""

    def __init__(self, most: int):
        self.sizes, self.members, self.held = sizes(most), most, False
        self.home, self.time = most, 0.0  # the number that is best as far as known; s of work until now
        self.substep = 0.0  # s, of late
        self.recent, self.best, self.compared = Span(), float("inf"), False
        self.away, self.trial, self.lost = 0, Span(), 0.0
        self.wait, self.due = {-1: SOONEST, 1: SOONEST}, {-1: 0.0, 1: 0.0}

    def hold(self, members: int) -> None:
        """Let so many share the work from now on, whatever it takes."""
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
        """The last launch did so many substeps, and so much work in all."""
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
        pace = self.recent.pace
        self.best = min(self.best, pace)
        slow = pace > SLOW * self.best or not self.compared
        for way, wanted in ((-1, slow), (1, True)):
            if wanted and self.time >= self.due[way] and self._try(way):
                return
        self.recent.fade()

    def _try(self, places: int) -> bool:
        """Let the next launch be of a team so many places beyond the usual one among `sizes`, if there is one."""
        place = self.sizes.index(self.home) + places
        there_is = 0 <= place < len(self.sizes)
        if there_is:
            self.members, self.away, self.trial, self.lost = self.sizes[place], places, Span(), 0.0
        return there_is

    def _judge(self) -> None:
        """End the trial if it has lost too much, or if it was long enough."""
        way = 1 if self.away > 0 else -1
        ends = self.trial.seconds > TRIALS[way]
        if self.lost > PATIENCE or (ends and self.trial.pace > GAIN * self.recent.pace):
            self._go_back(way)
        elif ends:
            self._settle(way)

    def _go_back(self, way: int) -> None:
        lost = max(0.0, self.trial.seconds - self.recent.pace * self.trial.work)
        self.wait[way] = max(min(2.0 * self.wait[way], LATEST), min(lost / SHARE, RAREST))
        self.due[way] = self.time + self.wait[way]
        if way < 0:
            if self._try(self.away - 1):
                return
            self.best, self.compared = self.recent.pace, True  # it is not the team that makes it slow
        self.members = self.home
        self.recent.fade()

    def _settle(self, way: int) -> None:
        self.home, self.best, self.compared = self.members, self.trial.pace, False
        self.recent = Span()
        self.wait[way] = max(0.5 * self.wait[way], SOONEST)
        self.due = {way: self.time, -way: self.time + self.wait[-way]}
