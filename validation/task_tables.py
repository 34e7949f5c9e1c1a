"""The tables of docs/tasks/: what each task is, how soon it could end at all, and what policies do on it, from submissions."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from crowd_env.agents import PRETRAINED, starts_from
from crowd_env.agents.evaluation.comparison import order_of, paired
from crowd_env.agents.evaluation.submission import REFERENCES, read_submission
from crowd_env.agents.evaluation.tiers import Standing, standing
from crowd_env.agents.networks import network_digest
from crowd_env.agents.tasks import PRESETS, TASKS
from crowd_env.agents.tasks.floors import RECORDED_FLOW, exit_widths, free_walk_time, touching_flow
from crowd_env.agents.tasks.tiers import SETTINGS
from crowd_env.agents.tasks.variations import AS_IT_STANDS, variations
from crowd_env.analysis.figures import cell
from crowd_env.core.files.json_file import read_json
from crowd_env.envs.action import make_action
from validation.pages import ROOT, Grid

SUBMISSIONS = ROOT / "docs/tasks/submissions"


def _upright(rows: list[dict[str, str]]) -> Grid:
    return [list(rows[0]), *(list(row.values()) for row in rows)]


def _listed(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in values.items())


def tasks() -> Grid:
    """One row a task, as it is registered."""
    return _upright([
        {
            "task": f"`{task.name}`{' (no harm)' if task.no_harm else ''}",
            "what it is": task.about,
            "scenario and its options": f"`{task.scenario}`: {_listed(task.options)}",
            "people": str(task.people),
            "scheme, step": f"`{task.scheme}`, {task.dt:g} s",
            "rule, manner": f"{task.rule}, {task.manner}",
            "time limit / blocked after": f"{task.time_limit:g} / {task.blocked_after:g} s",
            "draws": str(task.runs),
            "decides": task.decides,
            "version": str(task.version),
        }
        for task in TASKS.values()
    ])  # fmt: skip


def facts() -> Grid:
    """One row a task: what its own page says of it."""
    return _upright([
        {
            "task": task.name,
            "scenario": f"`{task.scenario}`: {_listed(task.options)}",
            "people": f"{task.people}, {task.manner}",
            "contact law, step": f"`{task.scheme}`, {task.dt:g} s",
            "a run ends": f"after {task.time_limit:g} s, or {task.blocked_after:g} s after the last exit: blocked",
            "held-out draws": f"{task.runs}, seeds {task.seeds.start} to {task.seeds.stop - 1}",
            "a policy decides": f"{task.decides}, every {task.decision_dt:g} s; the way is that of `{task.rule}`",
            "varied by": "; ".join(one.about for one in variations(task)[1:]),
            "version, digest": f"{task.version}, `{task.digest()}`",
        }
        for task in TASKS.values()
    ])  # fmt: skip


def presets() -> Grid:
    """One row a task that has a preset: what is seen, done and paid where a policy is trained for it."""
    return _upright([
        {
            "task": name,
            "people, step": f"{one.people}, {one.dt:g} s" + (f"; {_listed(one.options)}" if one.options else ""),
            "observation": ", ".join(f"`{term}`" for term in one.terms),
            "action": f"`{one.action if isinstance(one.action, str) else one.action['name']}`",
            "reward": f"{_listed(one.reward['weights'])}; team share {one.reward.get('team_share', 0.0):g}",
        }
        for name, one in ((name, PRESETS[name]) for name in TASKS if name in PRESETS)
    ])  # fmt: skip


def floors() -> Grid:
    """One row a task: how soon the last could be out alone, one behind the other, and at the flow of recorded people."""
    rows = []
    for name, task in TASKS.items():
        place, alone = task.place(), free_walk_time(task)
        width, touching = float(exit_widths(place).sum()), task.people / touching_flow(place)
        rows.append({
            "task": name,
            "floor, s": f"{max(alone, touching):.0f}",
            "the last person, alone, s": f"{alone:.1f}",
            "one behind the other through the exits, s": f"{touching:.1f}",
            f"at {RECORDED_FLOW:g} /(s m), s": f"{task.people / (RECORDED_FLOW * width):.0f}",
            "width of the exits, m": f"{width:.3g}",
        })  # fmt: skip
    return _upright(rows)


def tiers(folder: Path = ROOT / "docs/tasks/tiers") -> Grid:
    """One row a setting of the benchmark: its bound, and how near to it the best known policies are."""
    rows = []
    for one in SETTINGS:
        there = standing(one, folder)
        alike = one.variation is AS_IT_STANDS or one.variation.about.startswith("the task")
        rows.append({
            "tier": one.tier,
            "task": f"`{one.task.name}`",
            "setting": "as it stands" if alike else one.variation.about,
            "draws": str(one.runs),
            **(_stands(there) if there else dict.fromkeys(_STANDS, "not tried")),
        })  # fmt: skip
    return _upright(rows)


_STANDS = (
    "bound, s",
    "best learned policy",
    "half of all draws, s",
    "gap to the bound",
    "best rule, s",
    "hindsight, s",
)


def _stands(one: Standing) -> dict[str, str]:
    def told(left: int, time: float) -> str:
        return ("never" if np.isinf(time) else f"{time:.1f}") + (f", left in {left}" if left else "")

    gap = "–" if np.isinf(one.gap) else f"{100.0 * one.gap:+.0f} %".replace("-", "−")
    half = told(one.best_left, one.best_time)
    rule = f"{told(one.rule_left, one.rule_time)} (`{one.rule}`)"
    soonest = "never" if np.isinf(one.hindsight) else f"{one.hindsight:.1f}"
    return dict(zip(_STANDS, (f"{one.bound:.1f}", f"`{one.best}`", half, gap, rule, soonest), strict=True))


# ----------------------------------------------------------------------------------------------------------- submissions


def read_submissions(folder: Path = SUBMISSIONS) -> dict[str, list[dict[str, Any]]]:
    """Return the submissions in a folder by task, every one held against its task.

    Doubtful ones stand last, the others in the order of `crowd_env.agents.evaluation.comparison.order_of`.

    Raises
    ------
    ValueError
        If one does not fit its task, or two are of one policy.
    """
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in TASKS}
    for path in sorted(folder.glob("*/*.json")):
        one = read_submission(path)
        mine, those = one["policy"]["name"], found[one["task"]["name"]]
        if mine in [other["policy"]["name"] for other in those]:
            raise ValueError(f"{path}: {mine} has been submitted twice")
        those.append(one)
    for those in found.values():
        those.sort(key=lambda one: (_row(one)["credible"]["ok"] is False, order_of(_times(one))))
    return {name: those for name, those in found.items() if those}


def _times(content: dict[str, Any], policy: str = "") -> np.ndarray:
    """Return when the last person of each run was out [s]; nan where somebody was left inside."""
    named = (policy or content["policy"]["name"], "task")
    found = next(one for one in content["runs"] if (one["policy"], one["variation"]) == named)
    return np.array(found["last_time"], dtype=np.float64)


def _row(content: dict[str, Any], policy: str = "") -> dict[str, Any]:
    return dict(next(row for row in content["rows"] if row["policy"] == (policy or content["policy"]["name"])))


def submissions(folder: Path = SUBMISSIONS) -> Grid:
    """One row a policy, task by task: the rule at full and at its best speed, then what was submitted, the best first."""
    rows = []
    for name, those in read_submissions(folder).items():
        ours = [(those[0], policy) for policy in REFERENCES]
        ours += [(one, one["policy"]["name"]) for one in those if one["policy"]["name"] not in REFERENCES]
        rows += [{"task": name, **_judged(content, policy)} for content, policy in ours]
    return _upright(rows)


def _judged(content: dict[str, Any], policy: str) -> dict[str, str]:
    row, own, best = _row(content, policy), content["own"][-1], REFERENCES[1]
    later = paired(_times(content, policy), _times(content, best))
    row["star"] = "" if row["pressure_is_force"] else " (no forces)"
    crushed = "{crushed_share[mean]:%} %{star}"
    if row["crushed_time"]["mean"] is not None:
        crushed += ", {crushed_time[mean]:.1f} s"
    credible = {True: "yes", False: "**no**: " + "; ".join(row["credible"]["reasons"]), None: "not tried"}
    network = "" if policy in REFERENCES else content["policy"]["sha256"]
    return {
        "policy": f"`{policy}`" + (f", {row['constants']['share']:g}" if policy == best else ""),
        "starts from": "–" if network and policy not in PRETRAINED else starts_from(policy),
        "network": f"`{network[:12]}`" if network else "" if policy in REFERENCES else "–",
        "exits blocked": cell("{blocked} of {runs} ({blocked_share[ci95][0]:%} to {blocked_share[ci95][1]:%} %)", row),
        "left inside": str(row["left"] or "nobody"),
        "half of all draws, s": _half(row),
        "last person, s": _spread(row["clearing_time"]),
        "on its own draws": "" if policy in REFERENCES else cell("{clearing_time[mean]:.1f}", own) + _lost(own),
        f"beside `{best}`, s": "" if policy == best else _spread(later, "+"),
        "more draws with people left": "" if policy == best else f"{later['more_left']:+d}".replace("-", "−"),
        "mean exit, s": _spread(row["mean_exit"]),
        "flow, 1/s": cell("{flow:.2f}", row),
        "impulse, N s": cell("{contact_impulse[mean]:.0f}", row),
        "greatest pressure, kN/m": cell("{max_pressure[mean]:k}{star}", row),
        "above 1.6 kN/m": cell(crushed, row),
        "leaves people in more draws than the rule on": "" if policy in REFERENCES else _worse(content),
        "credible": credible[row["credible"]["ok"]],
    }


def _spread(found: dict[str, Any], sign: str = "") -> str:
    if found["mean"] is None:
        return "–"
    low, high = found["ci95"]
    text = f"{found['mean']:{sign}.1f}" + ("" if low is None else f" ({low:{sign}.1f} to {high:{sign}.1f})")
    return text.replace("-", "−")


def _half(row: dict[str, Any]) -> str:
    return "never" if row["median_time"] is None else f"{row['median_time']:.1f}"


def _lost(row: dict[str, Any]) -> str:
    return f", left in {row['unfinished']} of {row['runs']}" if row["unfinished"] else ""


def _worse(content: dict[str, Any]) -> str:
    """Return the variations on which a policy leaves somebody inside in more draws than the rule does."""
    if content["robustness"] is None:
        return "not tried"
    left = {(row["variation"], row["policy"]): row["unfinished"] for row in content["robustness"]["rows"]}
    mine = content["policy"]["name"]
    tried = [name for name, policy in left if policy == mine]
    return ", ".join(name for name in tried if left[name, mine] > left[name, REFERENCES[0]]) or "none"


def cards(folder: Path = SUBMISSIONS) -> Grid:
    """One row a shipped policy: what it sees and does, how it was trained, its digest, its figures and its limits."""
    judged = {one["policy"]["name"]: one for those in read_submissions(folder).values() for one in those}
    return _upright(
        [_card(name, read_json(path.with_suffix(".json")), judged.get(name)) for name, path in PRETRAINED.items()]
    )


def _card(name: str, made: dict[str, Any], judged: dict[str, Any] | None) -> dict[str, str]:
    config, spent, action = made["config"], made["spent"], make_action(made["config"]["action"])
    seen, prices = config["observation"], _listed(config["reward"]["weights"])
    figures, limits = "not submitted", "unchecked"
    trained = f"{config['people']} people, `{config['scenario']}`: {_listed(config['options'])}; `{config['scheme']}`, "
    trained += f"{config['dt']:g} s"
    if places := config.get("places"):
        trained = f"generated places of up to {places['people']} people and those of the tasks, under their laws"
        figures, limits = "[generated places](training.md#one-policy-for-every-place); the pages of the tasks", "there"
    elif judged is not None:
        row, worse = _row(judged), _worse(judged)
        figures = f"half of all draws {_half(row)} s; left somebody inside in {row['unfinished']} of {row['runs']}"
        figures += cell("; above 1.6 kN/m {crushed_share[mean]:%} %", row)
        known = ", ".join(_known_limits(judged)) or "none"
        limits = f"leaves people in more draws than the rule on: {worse}; 10 % slower than the rule on: {known}"
    between = "between two of " if places else ""
    choices = f", {between}{action.space.n} choices" if isinstance(action.space, gymnasium.spaces.Discrete) else ""
    return {
        "card": name.replace("/", "-"),
        "policy": f"`{name}`",
        "network, SHA-256": f"`{network_digest(PRETRAINED[name])}`",
        "sees": ", ".join(f"`{term}`" for term in seen["terms"])
        + f"; {seen['neighbors']} neighbors, {seen['rays']} rays; along the own way, no compass",
        "does": f"`{action.name}`{choices}, every {config['decision_dt']:g} s",
        "trained in": trained,
        "starts from": starts_from(name),
        "is paid": f"{prices}; team share {config['reward'].get('team_share', 0.0):g}",
        "took": f"{spent['steps'] / 1e6:.1f} million steps, {spent['cpu_seconds']:.0f} CPU s, seed {config['seed']}",
        "held-out draws": figures,
        "limits": limits if places else f"{limits}; other tasks than its own: see the tiers",
    }


def _known_limits(content: dict[str, Any]) -> list[str]:
    """Return the variations on which half of a policy's draws are over 10 % later than half of the rule's."""
    rows = () if content["robustness"] is None else content["robustness"]["rows"]
    half = {(row["variation"], row["policy"]): row["median_time"] for row in rows}
    mine = content["policy"]["name"]
    pairs = {name: (half[name, mine], half[name, REFERENCES[0]]) for name, policy in half if policy == mine}
    return [name for name, (own, rule) in pairs.items() if rule is not None and (own is None or own > 1.1 * rule)]


def varied(folder: Path = SUBMISSIONS) -> Grid:
    """One row a task and variation, one column a policy: when half of all draws were over, and those with people left."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for name, those in read_submissions(folder).items():
        about = {one.name: one.about for one in variations(TASKS[name])}
        tried = [one for one in those if one["robustness"] is not None]
        for row in (row for one in tried for row in one["robustness"]["rows"]):
            cells = found.setdefault((name, about[row["variation"]]), {})
            cells[f"`{row['policy']}`"] = _half(row) + _lost(row)
    policies = list(dict.fromkeys(policy for cells in found.values() for policy in cells))
    lines = ([*names, *(cells.get(policy, "") for policy in policies)] for names, cells in found.items())
    return [["task", "variation", *policies], *lines]


MAKERS: dict[str, Callable[[], Grid]] = {
    "tasks": tasks,
    "task-facts": facts,
    "task-presets": presets,
    "task-floors": floors,
    "tiers": tiers,
    "submissions": submissions,
    "variations": varied,
    "cards": cards,
}
