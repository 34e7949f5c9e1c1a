"""Crowds of one place, in turn with other programs: CPU time, person-steps, contacts and overlaps.

room20
    The room of Pécol et al. with 20 people, until it is empty.
big
    A room of 15 m with a door of 1 m: the first 20 s, in which the crowd packs in front of the door.
hall
    A square hall at 1.33 people/m2 with an exit of 4 m: people walk, few touch; the first 4 s.
jam
    A crowd at 6 people/m2 that touches and pushes to a door of 1.2 m.  People push for 0.1 s before anything is measured; then
    1 s counts (0.2 s of more than 10,000 people).  Overlaps belong to the speed: a solver that stops early is fast.
headway
    Hall and jam, with people who keep a distance and without.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measuring import Contender, Effort, Row, Sample, in_turn, timed, times
from benchmarks.peers import rivals
from benchmarks.scenes import Floats, Scene, big, chosen, hall, jam, overlaps, room20
from crowd_env import SCHEMES, Bodies, Physics, Simulation, make_state
from crowd_env.physics import NSM1, ContactScheme, make_scheme

COST, RATE = "CPU s per simulated s", "person-steps per CPU s"


class Way(NamedTuple):
    """A scheme, its time step [s] (None = the one that it takes for such a crowd by default), and how people walk."""

    scheme: str
    dt: float | None = None
    manner: str | None = None


OWN = [Way(name) for name in SCHEMES if name not in ("hertz-literal", "nsm1-loose", "nsm2-printed")]
PAIRS = [Way("dem", 0.001), Way("dem", 0.01), Way("nsm1", 0.01), Way("nsm2", 0.01), Way("hertz", 0.001), Way("hertz")]
# nsm1-loose stops where its overlap is a tenth of pymunk's, "1e-3" where the residual has fallen to that share.
VARIANTS: dict[str, ContactScheme] = {"nsm1 1e-3": NSM1(tolerance=1.0, relative_tolerance=1e-3)}
EARLY = [Way(name, 0.01) for name in ("nsm1-loose", *VARIANTS)]
CALM = [way._replace(manner=manner) for way in OWN for manner in (None, "calm")]

# Case -> scenes, their numbers of people, and who walks there.
CASES: dict[str, list[tuple[Callable[[int], Scene], tuple[int, ...], list[Way]]]] = {
    "room20": [(room20, (20,), OWN)],
    "big": [(big, (100, 200, 300), OWN)],
    "hall": [(hall, (1_000, 5_000, 20_000, 100_000), PAIRS)],
    "jam": [(jam, (1_000, 5_000, 10_000, 100_000), [*PAIRS, *EARLY])],
    "headway": [(hall, (1_000, 10_000), CALM), (jam, (1_000, 10_000), CALM)],
}
_PARTS = 8  # calls of a run


class Crowd(Contender):
    """A scene under one scheme, from its start or from where it has settled, over and over."""

    def __init__(self, scene: Scene, way: Way, field: Any, threads: int = 1) -> None:
        scheme = make_scheme(VARIANTS.get(way.scheme, way.scheme))
        dt = way.dt or scheme.default_dt(scene.bodies)
        self.name = f"{way.scheme} {dt:.3g} s" + (f" {way.manner}" if way.manner else "")
        self.whole, self._scene = scene.horizon, scene
        self.simulation = Simulation(
            scene.geometry,
            Bodies._make(column.copy() for column in scene.bodies),
            make_state(scene.position),
            physics=Physics(scheme, dt=dt, threads=threads),
            walking=way.manner,
            fields=[field],
        )
        self._advance(1)  # compiles
        self._start()

    def _advance(self, steps: int) -> None:
        self.simulation.advance(n_substeps=steps)

    def _start(self) -> None:
        """Put everyone back and let the crowd settle."""
        self.simulation.restart(0, self._scene.bodies, self._scene.position)
        self._left = round(self._scene.horizon / self.simulation.dt)
        if self._scene.settle:
            self._advance(round(self._scene.settle / self.simulation.dt))

    def once(self) -> Sample:
        """Go on for an eighth of a run, or what is left of it."""
        if not self._left or not self.simulation.inside[0]:
            self._start()
        steps = min(self._left, -(-round(self.whole / self.simulation.dt) // _PARTS))
        before, begin = int(self.simulation.inside[0]), float(self.simulation.state.time[0])
        spent = timed(lambda: self._advance(steps))
        simulated = float(self.simulation.state.time[0]) - begin
        inside = 0.5 * (before + int(self.simulation.inside[0]))
        self._left -= steps
        return Sample(*spent, simulated, inside * round(simulated / self.simulation.dt))

    def now(self) -> tuple[Bodies, Floats]:
        """Return the bodies of the people inside and their positions (K, 2) [m]."""
        inside = self.simulation.state.active
        return chosen(self.simulation.bodies, inside), self.simulation.state.position[inside]


def rows(case: str, effort: Effort) -> list[Row]:
    """Return the figures of a case, for all its scenes and sizes."""
    return [
        row
        for make, sizes, ways in CASES[case]
        for people in effort.sizes(sizes)
        for row in measure(make(people), effort, ways, case)
    ]


def measure(scene: Scene, effort: Effort, ways: Sequence[Way], case: str = "") -> list[Row]:
    """Return the figures of a scene under several schemes, and of other programs in the same scene."""
    effort.tell(f"{scene.people} people: placing them")
    field = scene.scenario.field()
    ours = [Crowd(scene, way, field) for way in ways]
    theirs = rivals(case, scene, effort)
    contenders: list[Any] = [*ours, *theirs]
    samples, place = in_turn(contenders, effort), f"{scene.place}, {scene.people} people"
    found: list[Row] = []
    for one, sample in zip(contenders, samples, strict=True):
        who = f"{one.name}, {place}"
        found += [Row(who, COST, sample.cost), Row(who, RATE, sample.rate)]
        if scene.people <= 10_000:
            bodies, position = one.now()
            depths = 1e3 * overlaps(scene.geometry, bodies, position) if len(position) else np.empty(0)
            found.append(Row(who, "contacts per person", len(depths) / max(len(position), 1)))
            found.append(Row(who, "overlap p99, mm", float(np.percentile(depths, 99)) if len(depths) else 0.0))
        if sample.simulated < 0.999 * one.whole:
            found.append(Row(who, "saw only, s", sample.simulated))
    speeds = {rival.name: 1.0 / sample.cost for rival, sample in zip(theirs, samples[len(ours) :], strict=True)}
    for crowd, mine in zip(ours, samples, strict=False):
        found += times(f"{crowd.name}, {place}", 1.0 / mine.cost, speeds)
    return found
