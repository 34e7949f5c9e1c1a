"""The evacuations of section 4.3, on a synthetic plan: the same draws with and without the control rules."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.metrics import summarise
from crowd_env.physics import NSM2, SocialForce
from crowd_env.reproduce.pecol2011.settings import Settings
from crowd_env.reproduce.pool import all_cores
from crowd_env.reproduce.result import Halfway, Progress, RawTable, Row
from crowd_env.reproduce.sound import require_nobody_outside
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Floats, Ints

RUNS = 100
ROUTES = ("A", "B")

# Table 7 of the paper: the exercise, its simulation [s].
PRINTED = {
    "last, A": ("45", "49.4"),
    "mean, A": ("31.1", "30.7"),
    "last, B": ("66", "62"),
    "mean, B": ("53.1", "48.6"),
    "last, all": ("66", "62"),
    "mean, all": ("44", "41.9"),
}
# How many took which route is not printed, but the three mean times leave no other whole numbers.
IMPLIED = {"people by A": (42, 38), "people by B": (59, 63)}

# "The adapted NSM2 that contained the socio-psychological force", Table 6; with the angle fixed at 90 degrees it is 1000 N
# from all sides.
SCHEME = NSM2(
    1e5, 0.0, reaction="printed", social=SocialForce(strength=1000.0, length=0.08, anisotropy=0.0, cutoff=0.64)
)

SYNTHETIC = (
    "The plan is SYNTHETIC: the paper draws its theatre in a figure that is in no printed text. Rooms, seats, doors, stairs, "
    "rectangles and who sits where are assumed (crowd_env/scenarios/shipped/theatre.py says how); the shortest ways were made "
    "to part the audience about as Table 7 implies. This is an illustration, not a validation."
)

_AT_ONCE = 10  # environments in a batch
_HEADER = ("rules", "seed", "person", "route", "time_s")


@dataclass(frozen=True, eq=False)
class Egress:
    """R evacuations of N people."""

    time: Floats  # (R, N)  s    when each got out; nan for those still inside at the time limit
    route: Ints  # (R, N)  row of `ROUTES` by which; -1
    ruled: Floats  # (R, 3)  s    how long each rule was on
    turned: Ints  # (R,)  how many people a rule turned away, if only for a moment

    def by(self, route: str) -> Floats:
        """Return the exit times (R, N) [s] of those who took a route; nan for all others."""
        return np.where(self.route == ROUTES.index(route), self.time, np.nan)

    @property
    def unfinished(self) -> int:
        """How many people are left inside, in all runs."""
        return int(np.isnan(self.time).sum())

    @cached_property
    def quantities(self) -> dict[str, Floats]:
        """What Table 7 prints or implies, of every run (R,); nan where there is none."""
        found: dict[str, Floats] = {}
        for name, times in (*((route, self.by(route)) for route in ROUTES), ("all", self.time)):
            out = np.isfinite(times)
            number = out.sum(axis=1)
            last = np.where(out, times, -np.inf).max(axis=1)
            found[f"last, {name}"] = np.where(number > 0, last, np.nan)
            found[f"mean, {name}"] = np.where(
                number > 0, np.where(out, times, 0.0).sum(axis=1) / np.maximum(number, 1), np.nan
            )
            if name in ROUTES:
                found[f"people by {name}"] = number.astype(np.float64)
        found["last, all"][np.isnan(self.time).any(axis=1)] = np.nan
        return found


_made: dict[tuple[int, int, bool], Egress] = {}  # Figure 6 rests on half of the runs of Table 7


def place() -> Scenario:
    """Return the theatre."""
    return make_scenario("theatre-v0")


def evacuate(settings: Settings, rules: bool, progress: Progress) -> Egress:
    """Run the draws ``seed`` to ``seed + runs - 1``, with or without the control rules; once for the same settings.

    Raises
    ------
    Halfway
        On Ctrl-C, with the exits of the runs that were finished by then.
    """
    key = settings.runs, settings.seed, rules
    if key in _made:
        progress(settings.runs)
        return _made[key]
    parts: list[tuple[Floats, Ints, Floats, Ints]] = []
    env, under_way = None, False
    try:
        for begin in range(0, settings.runs, _AT_ONCE):
            seeds = list(range(settings.seed + begin, settings.seed + min(begin + _AT_ONCE, settings.runs)))
            if env is None or env.num_envs != len(seeds):
                env = CrowdEnv(place(), num_envs=len(seeds), scheme=SCHEME, rules=rules, threads=all_cores())
            env.reset(seeds)
            under_way = True
            ruled, turned = np.zeros((len(seeds), 3)), np.zeros(env.num_people, dtype=np.bool_)
            while not env.finished.all():
                going = ~env.finished
                ended = env.step(None).info["finished"]
                state = env.simulation.state
                if rules:
                    ruled += env.decision_dt * (env.simulation.history.rule_on & going[:, None])
                    turned |= state.active & (env.simulation.history.followed != state.route)
                if ended.any():
                    progress(int(ended.sum()))
            require_nobody_outside(env.simulation)
            parts.append((_times(env), _routes(env), ruled, turned.reshape(len(seeds), -1).sum(axis=1)))
            under_way = False
    except KeyboardInterrupt:
        name = "yes" if rules else "no"
        runs = [
            (settings.seed + k, *run)
            for k, run in enumerate((t, r) for part in parts for t, r in zip(*part[:2], strict=True))
        ]
        if env is not None and under_way:
            here = np.flatnonzero(env.finished)
            runs += [
                (seeds[e], times, by) for e, times, by in zip(here, _times(env)[here], _routes(env)[here], strict=True)
            ]
        halfway = Halfway(RawTable(_HEADER, [row for run in runs for row in _exits(name, *run)]), len(runs))
        earlier = _made.get((settings.runs, settings.seed, True)) if not rules else None
        if earlier is not None:
            halfway = halfway.after(raw_times(settings, [("yes", earlier)]), settings.runs)
        raise halfway from None
    _made[key] = Egress(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    return _made[key]


def _times(env: CrowdEnv) -> Floats:
    """Return when everyone got out (E, N) [s]; nan for those who did not."""
    return env.simulation.state.exit_time.reshape(env.num_envs, -1).copy()


def _routes(env: CrowdEnv) -> Ints:
    """Return by which of `ROUTES` everyone got out (E, N); -1 for nobody's."""
    names = env.scenarios[0].geometry.exit_names
    row = np.array([*(ROUTES.index(name) for name in names), -1], dtype=np.int64)
    index = env.simulation.state.exit_index  # counted within the geometry; -1 takes the last entry
    return np.asarray(row[index]).reshape(env.num_envs, -1)


def mean_row(quantity: str, values: Floats, unit: str, reading: str, paper: str | None = None) -> Row:
    """Return the mean over the runs that have a value, with its spread."""
    known = values[np.isfinite(values)]
    if len(known) < 2:
        return Row(quantity, paper, float(known[0]) if len(known) else None, unit, len(known), reading)
    summary = summarise(known)
    return Row(quantity, paper, summary.mean, unit, len(known), reading, sd=summary.sd, ci95=summary.ci95)


def rows_with_rules(done: Egress) -> list[Row]:
    """Return the quantities of Table 7, the paper's simulation beside ours, the exercise named in words."""
    rows = []
    for name, (exercise, simulation) in PRINTED.items():
        values = done.quantities[name]
        row = mean_row(name, values, "s", "", simulation)
        off = "" if row.here is None else f" ({100 * (row.here / float(exercise) - 1):+.1f} %)"
        rows.append(mean_row(name, values, "s", f"exercise {exercise} s{off}", simulation))
    for name, (exercised, simulated) in IMPLIED.items():
        reading = f"implied: exercise {exercised}, paper's simulation {simulated}"
        rows.append(mean_row(name, done.quantities[name], "people", reading))
    return rows


def unfinished_row(quantity: str, done: Egress) -> Row:
    """Return how many are still inside at the time limit."""
    return Row(quantity, None, done.unfinished, "people", done.time.size, "at the time limit", closes=True)


def draws_remark(settings: Settings) -> str:
    """Return which draws were made, and of what."""
    last = settings.seed + settings.runs - 1
    draws = f"Draw {last} is" if settings.runs == 1 else f"Draws {settings.seed} to {last} are"
    return (
        f"{draws} people of Table 6 on the same seats, NSM2 with its social force (at an angle of 90 degrees: 1000 N from all "
        "sides, B = 0.08 m), h = 0.01 s. People are out at the far end of the corridor (A) or the stairs (B) behind the door."
    )


def raw_times(settings: Settings, results: Sequence[tuple[str, Egress]]) -> RawTable:
    """Return everybody's exit: rules, seed of the run, person, route and time (empty if never)."""
    runs = [
        (name, settings.seed + k, *run)
        for name, done in results
        for k, run in enumerate(zip(done.time, done.route, strict=True))
    ]
    return RawTable(_HEADER, [row for run in runs for row in _exits(*run)])


def _exits(rules: str, seed: int, times: Floats, routes: Ints) -> list[tuple[object, ...]]:
    return [
        (rules, seed, person, "" if by < 0 else ROUTES[by], "" if np.isnan(time) else f"{time:.6f}")
        for person, (by, time) in enumerate(zip(routes, times, strict=True))
    ]
