"""The team of threads that shares the particles of a system."""

from typing import Any

import taichi as ti

from taichi_jello.physics.forces._base import cut
from taichi_jello.physics.state import SERIAL_BELOW, Memory
from taichi_jello.physics.team_size import TeamSize
from taichi_jello.support import runtime

CACHE_LINE = 32  # numbers, more than one line: keeps the team's size apart from what all members write to


@ti.data_oriented
class Team:
    """Up to `team` threads; `size` chooses how many (see team_size.py). 0: parallel tasks, the form for a GPU."""

    def __init__(self, memory: Memory, team: int | None):
        self.memory, self.owner, self.count = memory, memory.owner, memory.particles
        self.lanes, self.passes = memory.lanes, memory.passes
        if team is None:
            threads = min(self.owner.threads, len(runtime.usable_cores())) if self.count >= SERIAL_BELOW else 1
            team = threads if self.owner.on_cpu else 0
        self.team = team
        self.size = TeamSize(team) if team > 1 else None
        if team > 1:
            self.arrivals: Any = ti.field(ti.i64, 1)  # how often threads came to wait_for_team in this launch
            self.now: Any = ti.field(ti.i32, 2 * CACHE_LINE)  # [CACHE_LINE]: how many share it

    @property
    def members(self) -> int:
        """How many threads share the next launch."""
        return self.size.members if self.size else self.team

    @ti.func
    def gather(self, members):
        """Before a loop over so many members of the team."""
        if ti.static(self.team > 1):
            self.now[CACHE_LINE] = members
            self.arrivals[0] = 0

    @ti.func
    def part_of(self, member):
        """The first particle of a member, and one past its last."""
        first, last = 0, self.count
        if ti.static(self.team > 1):
            members = self.now[CACHE_LINE]
            first = member * self.passes // members * self.lanes
            last = ti.min((member + 1) * self.passes // members * self.lanes, self.count)
        return first, last

    @ti.func
    def share_of(self, particle, points):
        """Where `points` of any kind are cut for a member whose particles are cut at `particle`."""
        return cut(self.count, particle, points)

    @ti.func
    def wait_for_team(self):
        """A barrier. Threads spin: waking them would take longer than a stage."""
        if ti.static(self.team > 1):
            members = self.now[CACHE_LINE]
            if members > 1:
                come = ti.atomic_add(self.arrivals[0], 1)
                everyone = (come // members + 1) * members
                while ti.atomic_max(self.arrivals[0], 0) < everyone:
                    pass
