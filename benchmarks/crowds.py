"""Crowds of one place, in turn with other programs: CPU time, person-steps, contacts and overlaps."""

import time
from collections.abc import Sequence
from typing import Any

from benchmarks.measuring import Contender, Effort, Row, Sample, in_turn, significant, times_better
from benchmarks.scenes import Depths, Floats, Scene, chosen
from crowd_env import SCHEMES, Bodies, Simulation, make_state
from crowd_env.physics import NSM1, ContactScheme

COST = "CPU s per s"  # CPU seconds per simulated second
# Scheme and time step [s].
PAIRS = (("dem", 0.001), ("dem", 0.01), ("nsm1", 0.01), ("nsm2", 0.01), ("hertz", 0.001))
DEFAULT_PAIRS = tuple(
    (name, scheme.info.default_dt) for name, scheme in SCHEMES.items() if name not in ("hertz-literal", "nsm2-printed")
)
# What is measured besides the schemes as they are.  The loose nsm1 stops where its overlap is a tenth of pymunk's, "1e-3"
# where the residual has fallen to that share of what it was.
VARIANTS: dict[str, ContactScheme] = {
    "nsm1 loose": NSM1(tolerance=0.13),
    "nsm1 1e-3": NSM1(tolerance=1.0, relative_tolerance=1e-3),
}
JAM_PAIRS = (
    ("dem", 0.001),
    ("dem", 0.01),
    ("nsm1", 0.01),
    ("nsm1 loose", 0.01),
    ("nsm1 1e-3", 0.01),
    ("nsm2", 0.01),
    ("hertz", 0.001),
)
_SETTLE_CPU = 6.0  # blocks: settling takes no longer


class Crowd:
    """A scene under one scheme, from its start or from where it has settled, over and over."""

    peer = None

    def __init__(
        self,
        scene: Scene,
        scheme: str,
        dt: float,
        effort: Effort,
        field: Any,
        threads: int = 1,
        look: bool = False,
        manner: str | None = None,
    ) -> None:
        self.name = f"{scheme} {dt:g} s" + (f" {manner}" if manner else "")
        self.whole = scene.horizon
        self._scene = scene
        self._patience = _SETTLE_CPU * effort.seconds
        self._steps_per_call = 1
        self.simulation = Simulation(
            scene.geometry,
            Bodies._make(column.copy() for column in scene.bodies),
            make_state(scene.position),
            scheme=VARIANTS.get(scheme, scheme),
            dt=dt,
            fields=[field],
            threads=threads,
            manner=manner,
        )
        self.depths = Depths(scene) if look else None
        self._begin = 0.0
        self._fresh = True
        self.simulation.advance(n_substeps=1)  # compiles
        self._start()

    def _start(self) -> None:
        """Put everyone back and let the crowd settle."""
        if not self._fresh or self._scene.settle == 0.0:
            self.simulation.restart(0, self._scene.bodies, self._scene.position)
        self._fresh = False
        begin = time.process_time()
        while self._time < self._scene.settle and time.process_time() - begin < self._patience:
            self._advance(self._patience / 10.0, self._scene.settle)
        self._begin = self._time

    @property
    def _time(self) -> float:
        return float(self.simulation.state.time[0])

    @property
    def settled(self) -> float:
        """How long [s] it settled before it was measured: less than the scene says if patience ran out."""
        return min(self._begin, self._scene.settle)

    def _advance(self, seconds: float, until: float) -> Sample:
        """Make one call of about so many CPU seconds, at most to the time ``until``."""
        simulation = self.simulation
        steps = max(1, min(self._steps_per_call, round((until - self._time) / simulation.dt)))
        before, start = int(simulation.inside[0]), self._time
        clock, begin = time.perf_counter(), time.process_time()
        simulation.advance(n_substeps=steps)
        spent, clock = time.process_time() - begin, time.perf_counter() - clock
        rounded = max(spent, 1e-5)
        self._steps_per_call = max(1, int(min(2 * steps, steps * seconds / rounded)))
        inside = 0.5 * (before + int(simulation.inside[0]))
        return Sample(spent, clock, self._time - start, inside * round((self._time - start) / simulation.dt))

    def block(self, effort: Effort) -> Sample:
        """Go on for about ``effort.seconds`` of CPU time and at least a step."""
        sums = Sample(0.0, 0.0, 0.0, 0.0)
        while sums.cpu < effort.seconds:
            if self._time >= self._begin + self.whole - 1e-9 or not self.simulation.inside[0]:
                self._start()
            part = self._time + self.whole / 4.0 if self.depths else self._begin + self.whole
            now = self._advance(effort.seconds / 4.0, min(part, self._begin + self.whole))
            if self.depths:
                self.depths.look(self._time - self._begin, self.now)
            sums = Sample(*(a + b for a, b in zip(sums, now, strict=True)))
        return sums

    def now(self) -> tuple[Bodies, Floats]:
        """Return those who are inside and where."""
        who = self.simulation.state.active
        return chosen(self.simulation.bodies, who), self.simulation.state.position[who]


def measure(
    scene: Scene,
    effort: Effort,
    pairs: Sequence[tuple[str, float]],
    rivals: Sequence[Contender] = (),
    *,
    detail: bool = True,
) -> list[Row]:
    """Return the figures of a scene under several schemes, and of ``rivals`` that walk in the same scene."""
    effort.tell(f"{scene.people} people: placing them")
    field = scene.scenario.field()
    ours = [Crowd(scene, scheme, dt, effort, field, look=detail) for scheme, dt in pairs]
    contenders: list[Contender] = [*ours, *rivals]
    found = in_turn(contenders, effort)
    rows: list[Row] = []
    for contender, sample in zip(contenders, found, strict=True):
        name = f"{contender.name}, {scene.people} people"
        rows.append(Row(f"{name}: CPU time", significant(sample.cost, 3), COST, contender.peer))
        rows.append(Row(f"{name}: person-steps", significant(sample.rate, 3), "1/CPU s", contender.peer))
        if detail:
            rows += state_rows(name, contender)
        seen = sample.simulated
        if seen < 0.999 * contender.whole:
            rows.append(Row(f"{name}: saw only", significant(seen, 3), "s", contender.peer))
        if isinstance(contender, Crowd) and contender.settled < 0.999 * scene.settle:
            rows.append(Row(f"{name}: settled for", significant(contender.settled, 3), "s"))
        failed = getattr(contender, "failed_at", None)
        if failed is not None:
            rows.append(Row(f"{name}: stopped at", significant(failed, 3), "s", contender.peer))
    count = len(ours)
    for crowd, mine in zip(ours, found[:count], strict=True):
        for rival, theirs in zip(rivals, found[count:], strict=True):
            cost = significant(mine.cost, 3)
            ratio = times_better(mine.cost, theirs.cost, COST)
            what = f"{crowd.name}, {scene.people} people: CPU time"
            rows.append(Row(what, cost, COST, f"{rival.name} ({rival.peer})", ratio))
    return rows


def state_rows(name: str, contender: Contender) -> list[Row]:
    """Return contacts and overlaps, if they were looked at."""
    depths: Depths | None = getattr(contender, "depths", None)
    figures = None if depths is None else depths.figures()
    if figures is None:
        return []
    p99, most, contacts = figures
    return [
        Row(f"{name}: overlap p99", significant(p99, 2), "mm", contender.peer),
        Row(f"{name}: overlap max", significant(most, 2), "mm", contender.peer),
        Row(f"{name}: in contact", significant(contacts, 2), "per person", contender.peer),
    ]
