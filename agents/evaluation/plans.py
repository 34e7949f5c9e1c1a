"""Policies in places that `crowd_env.scenarios.generated` draws: does everybody get out, how soon, and how hard do they press?

Every plan is one evacuation, under the law and the manner of its seed, with the noise and the delay of its seed.  All
policies walk along the same routes, `routing_of`, unless their actions choose others.  Plans have seeds from `HELD_OUT_SEED`
on, which no training draws.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Generic, NamedTuple, TypeAlias, TypeVar
from urllib.parse import quote

import numpy as np
from rich.table import Table

from crowd_env import CrowdEnv, Scenario, Step
from crowd_env.core.arrays.state import Bools, Floats, as_grid
from crowd_env.core.executors import Executor, Serial
from crowd_env.core.executors.executor import never
from crowd_env.core.files.json_file import json_number
from crowd_env.core.files.store import Store
from crowd_env.envs.metrics import share_interval
from crowd_env.envs.rollout import make_batches, simulate_batch
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics.pressure import INJURY, contact_pressure
from crowd_env.scenarios.generated import VERSION, conditions_of, draw_place

from .. import make_policy
from ..drivers import DrivenCrowd, Hindrance
from ..plain import Plain
from ..policy import Policy
from ..rules import StrategyPolicy
from .entries import RULE
from .folder import digest_of, source_stamp
from .goals import at_goals
from .report import table_of

PLANS = 2000
# Rules that a pedestrian could walk by: `zipper` knows more, and `rule-best-speed` asks for a search in every plan.
RULES = (RULE, "density-cap", "headway", "follow", "evolution", "yield-when-stuck")
HINDSIGHT = "best rule in hindsight"
BLOCK = 20  # plans of a piece of work
_COLUMNS = {
    "plans": "{plans}",
    "left in": "{left_in}",
    "elsewhere": "{elsewhere}",
    "all out,\nas meant, %": "{out:%1} ({out_interval[0]:%1}..{out_interval[1]:%1})",
    "above\n1.6 kN/m, %": "{pressed:%1} ({pressed_interval[0]:%1}..{pressed_interval[1]:%1})",
    "last out,\nIQM, s": "{time:half}",
    "over\nhindsight": "{over_hindsight:.3f}",
}


Of = TypeVar("Of", float, Floats)


class Outcome(NamedTuple, Generic[Of]):
    """What came of one policy in one plan, or in K of them (K,)."""

    time: Of  # s    when the last person was out; inf where somebody was left or strayed
    left: Of  # people left inside
    strayed: Of  # people out by an exit that their route does not lead to, see `strayed`
    pressure: Of  # N/m  greatest contact force on someone over circumference, mean of a decision step
    impulse: Of  # N s  contact impulse magnitudes per person


Outcomes: TypeAlias = Outcome[Floats]


class PressureRecorder:
    """Keeps the greatest pressure on anyone in each evacuation [N/m], mean of a decision step."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Forget the batch before."""
        self._most = np.zeros(env.num_envs)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Look at the contacts of a step."""
        simulation = env.simulation
        pressure = contact_pressure(simulation.results.impulse_magnitude, env.decision_dt, simulation.bodies.radius)
        there = env.active | step.truncated | step.terminated
        np.maximum(self._most, as_grid(np.where(there, pressure, 0.0), env.num_envs).max(axis=1), out=self._most)

    def record(self, env: CrowdEnv, e: int) -> float:
        """Return the greatest pressure of environment ``e``."""
        return float(self._most[e])


def routing_of(place: Scenario) -> str:
    """Return the strategy along whose routes everyone walks: the fastest where there are several exits."""
    return "fastest" if len(place.exits) > 1 else "shortest"


def judge_plans(
    policies: Sequence[str],
    plans: int = PLANS,
    *,
    first: int = HELD_OUT_SEED,
    most: int | None = None,
    folder: Path | None = None,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> dict[str, Outcomes]:
    """Run every policy in the same ``plans`` places, of the seeds from ``first`` on.

    Parameters
    ----------
    policies : names as `make_policy` takes them, and "rule", which is full speed along the way.
    most : plans of more people are not walked: their outcomes are nan.
    folder : keeps what is finished: an interrupted judgement goes on, and more plans or policies may be added.
    executor : does pieces of `BLOCK` plans; by default one after the other here.
    progress : called with the number of evacuations that have just ended.

    Raises
    ------
    ValueError
        If a policy is unknown, or the folder holds plans of another version of the generator.
    """
    store = None
    if folder is not None:
        store = Store(folder, {"generated": VERSION, "first": first, "block": BLOCK, "most": most})
    made_by = {name: {"network": digest_of(name), "code": source_stamp()} for name in policies}
    pieces = [(name, first + k, most) for k in range(0, plans, BLOCK) for name in policies]
    found: dict[tuple[str, int, int | None], Plain] = {}
    if store is not None:
        kept = {piece: store.load(_title(piece), made_by[piece[0]], redo=True) for piece in pieces}
        found = {piece: one for piece, one in kept.items() if one is not None}
    todo = [piece for piece in pieces if piece not in found]
    if progress is not None:
        progress(BLOCK * len(found))

    def done(number: int, outcome: Plain) -> None:
        piece = todo[number]
        found[piece] = outcome
        if store is not None:
            store.keep(_title(piece), outcome, made_by[piece[0]])
        if progress is not None:
            progress(BLOCK)

    (executor or Serial()).run(_judge_block, todo, done)

    def joined(name: str) -> Outcomes:
        blocks = [found[piece] for piece in pieces if piece[0] == name]
        parts = ([one for block in blocks for one in block[part]] for part in Outcome._fields)
        of = Outcome(*(np.array(values, dtype=np.float64)[:plans] for values in parts))
        return of._replace(time=np.where(of.left + of.strayed > 0.0, np.inf, of.time))

    return {name: joined(name) for name in policies}


def _judge_block(piece: tuple[str, int, int | None], stopped: Callable[[], bool]) -> Plain:
    """Return the outcomes of a policy in `BLOCK` plans, a list for each part; infinite times are None."""
    name, first, most = piece
    found = [judge_plan(name, seed, most, stopped) for seed in range(first, first + BLOCK)]
    return {part: [json_number(getattr(one, part)) for one in found] for part in Outcome._fields}


def judge_plan(
    policy: str | Policy, seed: int, most: int | None = None, stopped: Callable[[], bool] = never
) -> Outcome[float]:
    """Run one policy in the place of a ``seed``, the draw of people being that of the seed too."""
    place, (law, manner, *hindrance) = draw_place(seed=seed), conditions_of(seed)
    if most is not None and place.population.people > most:
        return Outcome(*[np.nan] * len(Outcome._fields))
    routing = routing_of(place)
    driver = DrivenCrowd(
        StrategyPolicy(routing, name=RULE) if policy == RULE else make_policy(policy),
        place,
        {"physics": law, "walking": manner, "routing": routing},
        hindrance=Hindrance(*hindrance),
        passes_rest=True,
    ).settled()
    batches = make_batches(place, 1, seed=seed, driver=driver, recorder=PressureRecorder())
    episodes = simulate_batch(batches[0], stopped).episodes
    if not episodes:
        raise KeyboardInterrupt
    found, left = at_goals(episodes[0], place), episodes[0].metrics.unfinished
    metrics = found.metrics
    time = np.inf if metrics.unfinished else metrics.evacuation_time
    return Outcome(time, left, metrics.unfinished - left, found.record, metrics.contact_impulse)


def hindsight(found: Mapping[str, Outcomes], rules: Sequence[str] = RULES) -> Floats:
    """Return the time [s] of the rule that was soonest in each plan (K,); inf where all of them left somebody."""
    return np.asarray(np.min([found[name].time for name in rules if name in found], axis=0))


def interquartile_mean(values: Floats) -> Floats:
    """Return the mean of the middle half along the last axis; a quarter, rounded down, is cut off at each end.

    Up to a quarter may be infinite: times of those who never get out.
    """
    ordered = np.sort(values, axis=-1)
    cut = ordered.shape[-1] // 4
    return np.asarray(ordered[..., cut : ordered.shape[-1] - cut].mean(axis=-1))


def figures(found: Mapping[str, Outcomes]) -> list[Plain]:
    """Return a row for each policy, and one for the best rule of each plan picked in hindsight, ready for JSON.

    ``out`` is the share of plans in which everybody got out where they meant to; ``left_in`` counts the plans in which somebody
    was left inside, ``elsewhere`` the others in which somebody strayed.  ``pressed`` is the share in which somebody once bore
    more than `INJURY`; shares have Wilson intervals.  ``time`` [s] is the interquartile mean over plans of the time of the last
    person, ``over_hindsight`` the median over plans of the time over that of the best rule, of plans that both cleared.
    """
    rules = [found[name] for name in RULES if name in found]
    best = hindsight(found) if rules else np.full_like(next(iter(found.values())).time, np.inf)
    rows = [_row(name, one.time, one.left, best, one.pressure) for name, one in found.items()]
    if np.isfinite(best).any():
        rows.append(_row(HINDSIGHT, best, np.min([one.left for one in rules], axis=0), best))
    return rows


def _row(name: str, time: Floats, left: Floats, best: Floats, pressure: Floats | None = None) -> Plain:
    plans, out = len(time), np.isfinite(time)
    both, inside = out & np.isfinite(best), ~out & (left > 0.0)
    row = {
        "policy": name,
        "plans": plans,
        **_share("out", out),
        "left_in": int(inside.sum()),
        "elsewhere": int((~out & ~inside).sum()),
        "time": json_number(float(interquartile_mean(time))),
        "over_hindsight": json_number(np.median(time[both] / best[both])) if both.any() else None,
    }
    if pressure is None:
        return row
    return row | {**_share("pressed", pressure > INJURY), "median_pressure": float(np.median(pressure))}


def _share(name: str, those: Bools) -> Plain:
    return {name: float(those.mean()), f"{name}_interval": list(share_interval(int(those.sum()), len(those)))}


def table(rows: Sequence[Plain], title: str) -> Table:
    """Return the figures of policies as a table."""
    return table_of(
        {"": rows}, _COLUMNS, "IQM: interquartile mean over plans; %: with its 95 % interval (Wilson).", title
    )


def _title(piece: tuple[str, int, int | None]) -> str:
    policy, first, _ = piece
    return f"{quote(policy, safe='')}-{first}"
