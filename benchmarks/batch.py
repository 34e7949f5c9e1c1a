"""The batch environment over arrays: physics, observation, reward and automatic restart, a decision each 0.1 s.

Everyone acts (1, 0), straight to the exit, through the same door as a policy's actions.  Before anything is measured the batch
runs for 10 simulated seconds (or as long as there is patience), so that rooms are in several phases of an evacuation.  An
agent-step is one decision (ten physics steps; hertz: a hundred) of someone who is inside; slots of people who are out are not
counted.
"""

import time
from collections.abc import Sequence

import numpy as np

from benchmarks.measuring import Contender, Effort, Row, Sample, Stopwatch, in_turn, significant, times_better
from benchmarks.peers import batch_rivals
from crowd_env import SCHEMES, CrowdEnv, Physics

SIZES = ((256, 20), (256, 50))  # rooms of 5 m, people in each
_SETTLE = 100  # decision steps
_SETTLE_CPU = 6.0  # blocks: settling takes no longer
_RATE = "1/CPU s"


class Rooms:
    """A batch of rooms under one scheme."""

    peer = None
    whole = 8.0  # s    about an evacuation: shorter blocks see only a phase of it

    def __init__(self, scheme: str, rooms: int, people: int, settle: int, effort: Effort, threads: int = 1) -> None:
        self.name = scheme
        self.env = CrowdEnv(
            "room-v0", num_envs=rooms, physics=Physics(scheme, threads=threads), autoreset=True, people=people
        )
        self.env.reset(seed=0)
        self._forward = np.tile(np.array([1.0, 0.0], dtype=np.float32), (self.env.num_people, 1))
        begin = time.process_time()
        for _ in range(settle):
            self.env.step(self._forward)
            if time.process_time() - begin > _SETTLE_CPU * effort.seconds:
                break
        self._physics = Stopwatch(self.env.simulation, "advance")
        self._spent, self._inside, self._slots = 0.0, 0, 0

    def block(self, effort: Effort) -> Sample:
        """Make decisions for about ``effort.seconds`` of CPU time."""
        begin, clock, decisions, inside = time.process_time(), time.perf_counter(), 0, 0
        while time.process_time() - begin < effort.seconds:
            inside += int(self.env.active.sum())
            self.env.step(self._forward)
            decisions += 1
        spent = time.process_time() - begin
        self._spent += spent
        self._inside += inside
        self._slots += decisions * self.env.num_people
        return Sample(spent, time.perf_counter() - clock, decisions * self.env.decision_dt, inside)

    @property
    def share_of_physics(self) -> float:
        """Share of the CPU time so far that went to `Simulation.advance`."""
        return min(1.0, self._physics.seconds / self._spent)

    @property
    def share_inside(self) -> float:
        """Share of slots so far with someone inside."""
        return self._inside / self._slots


def rows(effort: Effort, sizes: Sequence[tuple[int, int]] = SIZES, settle: int = _SETTLE) -> list[Row]:
    """Return the figures of every scheme and size."""
    schemes = [name for name in SCHEMES if name != "hertz-literal"]
    found: list[Row] = []
    for rooms, people in sizes:
        found += measure(effort, schemes, rooms, people, settle)
    return found


def measure(effort: Effort, schemes: Sequence[str], rooms: int, people: int, settle: int) -> list[Row]:
    """Return agent-steps per CPU second, the share of the physics, and the ratio to other environments."""
    ours: list[Rooms] = []
    for scheme in schemes:
        effort.tell(f"{scheme}, {rooms} x {people}: letting rooms fall out of step")
        ours.append(Rooms(scheme, rooms, people, settle, effort))
    others = batch_rivals(rooms, people, effort)
    contenders: list[Contender] = [*ours, *others]
    samples = in_turn(contenders, effort)
    found: list[Row] = []
    for one, sample in zip(contenders, samples, strict=True):
        # Other environments come in sizes of their own and say so in their names.
        name = one.name if one.peer else f"{one.name}, {rooms} x {people}"
        found.append(Row(f"{name}: agent-steps", significant(sample.rate, 3), _RATE, one.peer))
        if isinstance(one, Rooms):
            found.append(Row(f"{name}: in physics", significant(one.share_of_physics, 2), "of CPU time"))
            found.append(Row(f"{name}: inside", significant(one.share_inside, 2), "of slots"))
    for mine, sample in zip(ours, samples, strict=False):
        for rival, theirs in zip(others, samples[len(ours) :], strict=True):
            what = f"{mine.name}, {rooms} x {people}: agent-steps"
            ratio = times_better(sample.rate, theirs.rate, _RATE)
            found.append(Row(what, significant(sample.rate, 3), _RATE, f"{rival.name} ({rival.peer})", ratio))
    return found
