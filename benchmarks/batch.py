"""Environments that are stepped: batches of rooms over arrays, and 200 agents as PettingZoo's dictionaries.

Everyone acts (1, 0), straight to the exit.  An agent-step is one decision of 0.1 s of a pedestrian who is inside, with physics,
observation, reward and automatic restart.  Before anything is measured a batch runs for 10 simulated seconds, so that rooms are
in several phases of an evacuation.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.measuring import Contender, Effort, Row, Sample, Stepped, Stopwatch, in_turn, timed, times
from benchmarks.peers import batch_rivals
from crowd_env import SCHEMES, CrowdEnv, Physics, make_scenario, parallel_env

SIZES = ((1, 20), (256, 20), (256, 50))  # rooms of 5 m, people in each
OWN = tuple(name for name in SCHEMES if name not in ("hertz-literal", "nsm1-loose"))
RATE = "agent-steps per CPU s"
_SETTLE, _EPISODE = 100, 50  # decision steps, of a batch before it is measured, and of a run over dictionaries


class Rooms(Contender):
    """A batch of rooms under one scheme."""

    whole = 8.0  # s    about an evacuation: shorter blocks see only a phase of it

    def __init__(
        self, scheme: str, rooms: int, people: int, settle: int = _SETTLE, threads: int = 1, **options: float
    ) -> None:
        self.name, place = f"{scheme}, {rooms} x {people}", make_scenario("room-v0", people=people, **options)
        self.env = CrowdEnv(place, num_envs=rooms, physics=Physics(scheme, threads=threads), autoreset=True)
        self.env.reset(seed=0)
        self._forward = np.tile(np.array([1.0, 0.0], dtype=np.float32), (self.env.num_people, 1))
        for _ in range(settle):
            self.env.step(self._forward)
        self.physics = Stopwatch(self.env.simulation, "advance")
        self.looking = Stopwatch(self.env.observer, "look")  # within that

    def once(self) -> Sample:
        """Make a decision."""
        inside = int(self.env.active.sum())
        return Sample(*timed(lambda: self.env.step(self._forward)), self.env.decision_dt, inside)

    @property
    def inside(self) -> float:
        """Share of the slots in which someone was inside."""
        return self.all.steps / (self.all.simulated / self.env.decision_dt * self.env.num_people)


def _dictionaries(agents: int) -> Stepped:
    """Return a PettingZoo ParallelEnv in which each agent acts with a separate array."""
    env = parallel_env(make_scenario("room-v0", people=agents, side=15.0, door_width=1.0), physics="nsm2")
    actions = {agent: np.array([1.0, 0.0], dtype=np.float32) for agent in env.possible_agents}

    def step() -> object:
        return env.step({agent: actions[agent] for agent in env.agents})

    name, reset = f"nsm2, dictionaries of {agents}", partial(env.reset, seed=0)
    return Stepped(name, step, lambda: len(env.agents), reset, _EPISODE)


def rows(
    effort: Effort, sizes: Sequence[tuple[int, int]] = SIZES, settle: int = _SETTLE, schemes: Sequence[str] = OWN
) -> list[Row]:
    """Return agent-steps, the share of the physics, and the ratio to other environments, for every scheme and size."""
    found: list[Row] = []
    for rooms, people in sizes:
        effort.tell(f"{rooms} x {people}: letting rooms fall out of step")
        ours = [Rooms(scheme, rooms, people, settle) for scheme in schemes]
        theirs = batch_rivals(rooms, people, effort) if rooms > 1 else []
        samples = in_turn([*ours, *theirs], effort)
        found += [Row(one.name, RATE, sample.rate) for one, sample in zip([*ours, *theirs], samples, strict=True)]
        speeds = {
            other.name.partition(",")[0]: sample.rate
            for other, sample in zip(theirs, samples[len(ours) :], strict=True)
        }
        for one, mine in zip(ours, samples, strict=False):
            physics = one.physics.seconds - one.looking.seconds
            found.append(Row(one.name, "physics, of CPU time", min(1.0, physics / one.all.cpu)))
            found.append(Row(one.name, "inside, of slots", one.inside))
            found += times(one.name, mine.rate, speeds)
    return found


def dictionaries(effort: Effort, agents: int = 200) -> list[Row]:
    """Return agent-steps of dictionaries, and how many times those of arrays in the same room they are."""
    arrays = Rooms("nsm2", 1, agents, settle=0, side=15.0, door_width=1.0)
    both: list[Contender] = [_dictionaries(agents), arrays]
    samples = in_turn(both, effort)
    found = [Row(one.name, RATE, sample.rate) for one, sample in zip(both, samples, strict=True)]
    return [*found, *times(both[0].name, samples[0].rate, {"arrays": samples[1].rate})]
