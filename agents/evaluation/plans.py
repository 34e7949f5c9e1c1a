"""Policies in places that `crowd_env.scenarios.generated` draws: does everybody get out, how soon, and how hard do they press?

Every plan is one evacuation, under the law and the manner of its seed, with the noise of its seed on what a policy sees.  All
policies walk along the same routes, `routing_of`, unless their actions choose others.  Plans have seeds from `HELD_OUT_SEED`
on, which no training draws.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
from rich.table import Table

from crowd_env import CrowdEnv, Scenario, Step
from crowd_env.analysis.results.measurements import INJURY
from crowd_env.core.arrays.state import Floats, as_grid
from crowd_env.core.executors import Executor, Serial
from crowd_env.core.executors.executor import never
from crowd_env.core.files.json_file import json_number
from crowd_env.core.files.store import Store
from crowd_env.envs.metrics import share_interval
from crowd_env.envs.rollout import make_batches, simulate_batch
from crowd_env.physics.pressure import contact_pressure
from crowd_env.scenarios.generated import VERSION, conditions_of, draw_place

from .. import PRETRAINED, make_policy
from ..drivers import DrivenCrowd, Hindrance
from ..networks import network_digest
from ..policy import Policy
from ..rules import StrategyPolicy
from ..trained import names_file
from .entries import RULE
from .evaluation import HELD_OUT_SEED
from .folder import source_stamp
from .goals import at_goals

PLANS = 2000
# Rules that a pedestrian could walk by: `zipper` knows more, and `rule-best-speed` asks for a search in every plan.
RULES = (RULE, "density-cap", "headway", "follow", "evolution", "yield-when-stuck")
HINDSIGHT = "best rule in hindsight"
BLOCK = 20  # plans of a piece of work


class Outcomes(NamedTuple):
    """What came of one policy in K plans."""

    time: Floats  # (K,)  s    when the last person was out; inf where somebody was left or strayed
    left: Floats  # (K,)  people left inside
    strayed: Floats  # (K,)  people out by an exit that their route does not lead to, see `strayed`
    pressure: Floats  # (K,)  N/m  greatest contact force on someone over circumference, mean of a decision step
    impulse: Floats  # (K,)  N s  contact impulse magnitudes per person


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
    facts = {"generated": VERSION, "first": first, "block": BLOCK, "most": most}
    store = None if folder is None else Store(folder, facts)
    blocks = -(-plans // BLOCK)
    pieces = [(name, first + BLOCK * k, most) for k in range(blocks) for name in policies]
    made_by = {name: _made_by(name) for name in policies}
    found: dict[tuple[str, int, int | None], Mapping[str, Any]] = {}
    for piece in pieces if store is not None else ():
        kept = store.load(_title(*piece[:2]), made_by[piece[0]], redo=True) if store is not None else None
        if kept is not None:
            found[piece] = kept
    todo = [piece for piece in pieces if piece not in found]
    if progress is not None:
        progress(BLOCK * len(found))

    def done(number: int, outcome: Mapping[str, Any]) -> None:
        found[todo[number]] = outcome
        if store is not None:
            store.keep(_title(*todo[number][:2]), outcome, made_by[todo[number][0]])
        if progress is not None:
            progress(BLOCK)

    (executor or Serial()).run(_judge_block, todo, done)

    def joined(name: str, part: str) -> Floats:
        values = [found[name, first + BLOCK * k, most][part] for k in range(blocks)]
        return np.concatenate([np.array(one, dtype=np.float64) for one in values])[:plans]

    found_of = {name: Outcomes(*(joined(name, part) for part in Outcomes._fields)) for name in policies}
    return {
        name: one._replace(time=np.where(one.left + one.strayed > 0.0, np.inf, one.time))
        for name, one in found_of.items()
    }


def _judge_block(piece: tuple[str, int, int | None], stopped: Callable[[], bool]) -> dict[str, list[float | None]]:
    """Return the outcomes of a policy in `BLOCK` plans, as `Outcomes` without the infinite times."""
    name, first, most = piece
    found = [judge_plan(name, seed, most, stopped) for seed in range(first, first + BLOCK)]
    return {part: [json_number(getattr(one, part)) for one in found] for part in Outcomes._fields}


class Outcome(NamedTuple):
    """What came of one policy in one plan; the fields are those of `Outcomes`."""

    time: float  # s    0 where somebody was left or strayed
    left: float
    strayed: float
    pressure: float  # N/m
    impulse: float  # N s


def judge_plan(
    policy: str | Policy, seed: int, most: int | None = None, stopped: Callable[[], bool] = never
) -> Outcome:
    """Run one policy in the place of a ``seed``, the draw of people being that of the seed too."""
    place, (law, manner, noise) = draw_place(seed=seed), conditions_of(seed)
    if most is not None and place.population.people > most:
        return Outcome(*[np.nan] * len(Outcome._fields))
    who = StrategyPolicy(routing_of(place), name=RULE) if policy == RULE else make_policy(policy)
    driver = DrivenCrowd(
        who,
        place,
        {"physics": law, "walking": manner, "routing": routing_of(place)},
        hindrance=Hindrance(noise=noise),
        passes_rest=True,
    ).settled()
    batches = make_batches(place, 1, seed=seed, driver=driver, recorder=PressureRecorder())
    episodes = simulate_batch(batches[0], stopped).episodes
    if not episodes:
        raise KeyboardInterrupt
    episode, left = at_goals(episodes[0], place), episodes[0].metrics.unfinished
    missing = episode.metrics.unfinished
    return Outcome(
        0.0 if missing else float(episode.metrics.evacuation_time),
        left,
        missing - left,
        episode.record,
        float(episode.metrics.contact_impulse),
    )


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


def figures(found: Mapping[str, Outcomes]) -> list[dict[str, Any]]:
    """Return a row for each policy, and one for the best rule of each plan picked in hindsight, ready for JSON.

    ``out`` is the share of plans in which everybody got out where they meant to; ``left_in`` counts the plans in which somebody
    was left inside, ``elsewhere`` the others in which somebody strayed.  ``pressed`` is the share in which somebody once bore
    more than `INJURY`; shares have Wilson intervals.  ``time`` [s] is the interquartile mean over plans of the time of the last
    person, ``over_hindsight`` the median over plans of the time over that of the best rule, of plans that both cleared.
    """
    plans, rules = len(next(iter(found.values())).time), [found[name] for name in RULES if name in found]
    best = hindsight(found) if rules else np.full(plans, np.inf)
    rows = [_row(name, one.time, one.left, best, one) for name, one in found.items()]
    if np.isfinite(best).any():
        rows.append(_row(HINDSIGHT, best, np.min([one.left for one in rules], axis=0), best))
    return rows


def _row(name: str, time: Floats, left: Floats, best: Floats, one: Outcomes | None = None) -> dict[str, Any]:
    plans, out = len(time), np.isfinite(time)
    both, inside = out & np.isfinite(best), ~out & (left > 0.0)
    row: dict[str, Any] = {"policy": name, "plans": plans, "out": float(out.mean())}
    row |= {"left_in": int(inside.sum()), "elsewhere": int((~out & ~inside).sum())}
    row |= {
        "out_interval": list(share_interval(int(out.sum()), plans)),
        "time": json_number(float(interquartile_mean(time))),
    }
    row["over_hindsight"] = json_number(np.median(time[both] / best[both])) if both.any() else None
    if one is not None:
        pressed = one.pressure > INJURY
        row |= {"pressed": float(pressed.mean()), "pressed_interval": list(share_interval(int(pressed.sum()), plans))}
        row["median_pressure"] = float(np.median(one.pressure))
    return row


def table(rows: Sequence[Mapping[str, Any]], title: str) -> Table:
    """Return the figures of policies as a table."""
    made = Table(title=title, caption="IQM: interquartile mean over plans; intervals: Wilson, 95 %")
    heads = (
        "policy",
        "plans",
        "somebody left in",
        "somebody elsewhere",
        "all out, as meant",
        "somebody above 1.6 kN/m",
        "last out, IQM, s",
        "over hindsight",
    )
    for k, head in enumerate(heads):
        made.add_column(head, justify="left" if k == 0 else "right")
    for row in rows:
        out, pressed = (_share(row, name) for name in ("out", "pressed"))
        over = "" if row["over_hindsight"] is None else f"{row['over_hindsight']:.3f}"
        time = "never" if row["time"] is None else f"{row['time']:.1f}"
        counts = (str(row[name]) for name in ("plans", "left_in", "elsewhere"))
        made.add_row(row["policy"], *counts, out, pressed, time, over)
    return made


def _share(row: Mapping[str, Any], name: str) -> str:
    if name not in row:
        return ""
    low, high = (100.0 * bound for bound in row[f"{name}_interval"])
    return f"{100.0 * row[name]:.1f} % ({low:.1f} to {high:.1f})"


def _title(policy: str, first: int) -> str:
    return f"{quote(policy, safe='')}-{first}"


def _made_by(policy: str) -> dict[str, Any]:
    """Return what decides the outcomes of a policy beside the plans: its network and the code."""
    path = PRETRAINED.get(policy, Path(policy) if names_file(policy) else None)
    return {"network": None if path is None else network_digest(path), "code": source_stamp()}
