"""The tables of docs/tasks/: what a task is, its floor, and what policies do on it, from the submissions that lie there."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.agents.evaluation.comparison import paired
from crowd_env.agents.evaluation.submission import REFERENCES, read_submission
from crowd_env.agents.tasks import PRESETS, TASKS
from crowd_env.agents.tasks.floors import RECORDED_FLOW, exit_widths, free_walk_time, touching_flow
from crowd_env.agents.tasks.variations import variations

if TYPE_CHECKING:
    from validation.pages import Sources

Cells = list[list[str]]
Submissions = dict[str, list[dict[str, Any]]]  # by task

FOLDER = Path(__file__).resolve().parent.parent / "docs/tasks/submissions"
FACTS_HEAD = ("", "")
PRESET_HEAD = ("trained with", "")
RESULTS_HEAD = (
    "policy",
    "exits blocked",
    "left inside",
    "last person, s",
    "beside `rule-best-speed`, s",
    "mean exit, s",
    "flow, 1/s",
    "impulse, N s",
    "greatest pressure, kN/m",
    "above 1.6 kN/m",
    "credible",
)
LEADERS_HEAD = ("task", "policy", "network", *RESULTS_HEAD[1:5], "blocks more than the rule on", "credible")


def facts(name: str) -> Callable[["Sources"], Cells]:
    """Return what makes the rows of the table that says what a task is."""

    def rows(source: "Sources") -> Cells:
        task = TASKS[name]
        options = ", ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in task.options.items())
        return [
            ["scenario", f"`{task.scenario}`: {options}"],
            ["people", f"{task.people}, {task.manner}"],
            ["contact law, step", f"`{task.scheme}`, {task.dt:g} s"],
            ["a run ends", f"after {task.time_limit:g} s, or {task.blocked_after:g} s after the last exit: blocked"],
            ["held-out draws", f"{task.runs}, seeds {task.seeds.start} to {task.seeds.stop - 1}"],
            ["a policy decides", f"{task.decides}, every {task.decision_dt:g} s; the way is that of `{task.rule}`"],
            ["varied by", "; ".join(one.about for one in variations(task)[1:])],
            ["version, digest", f"{task.version}, `{task.digest()}`"],
        ]

    return rows


def preset(name: str) -> Callable[["Sources"], Cells]:
    """Return what makes the rows of the table that says what is seen, done and paid where a policy is trained for a task."""

    def rows(source: "Sources") -> Cells:
        if name not in PRESETS:
            return []
        one = PRESETS[name]
        weights = ", ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in one.reward["weights"].items())
        place = ", ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in one.options.items())
        return [
            ["people, step", f"{one.people}, {one.dt:g} s" + (f"; {place}" if place else "")],
            ["observation", ", ".join(f"`{term}`" for term in one.terms)],
            ["action", f"`{one.action if isinstance(one.action, str) else one.action['name']}`"],
            ["reward", f"{weights}; team share {one.reward.get('team_share', 0.0):g}"],
        ]

    return rows


def floor(name: str) -> Callable[["Sources"], str]:
    """Return what says how soon a task could end at all."""

    def note(source: "Sources") -> str:
        task = TASKS[name]
        place, width = task.place(), float(exit_widths(task.place()).sum())
        alone = free_walk_time(task)
        touching, recorded = task.people / touching_flow(place), task.people / (RECORDED_FLOW * width)
        best, human = max(alone, touching), ""
        if recorded > best:
            human = f": less than {recorded:.0f} s says more about the contact law than about people"
        return (
            f"**Floor: {best:.0f} s.** If nobody stood in anyone's way, the last of {task.people} people would be out after "
            f"{alone:.1f} s (mean over crowds). One behind the other, touching, as many abreast as bodies fit, each at the own "
            f"desired speed, they pass the exits of {width:.3g} m in {touching:.1f} s. At the {RECORDED_FLOW:g} /(s m) that "
            f"people were recorded to pass a door of 1 m (Seyfried et al. 2009) it would be {recorded:.0f} s{human}."
        )

    return note


@cache
def submissions(folder: Path = FOLDER) -> Submissions:
    """Return the submissions in a folder by task, every one held against its task.

    Raises
    ------
    ValueError
        If one does not fit its task, or two are of one policy.
    """
    found: Submissions = {}
    for path in sorted(folder.glob("*/*.json")):
        one = read_submission(path)
        beside = found.setdefault(one["task"]["name"], [])
        if one["policy"]["name"] in [other["policy"]["name"] for other in beside]:
            raise ValueError(f"{path}: {one['policy']['name']} has been submitted twice")
        beside.append(one)
    return found


def _runs(content: dict[str, Any], policy: str, variation: str = "task") -> dict[str, Any]:
    return next(one for one in content["runs"] if (one["policy"], one["variation"]) == (policy, variation))


def _row(content: dict[str, Any], policy: str) -> dict[str, Any]:
    found: dict[str, Any] = next(row for row in content["rows"] if row["policy"] == policy)
    return found


def results(name: str) -> Callable[["Sources"], Cells]:
    """Return what makes a row for each policy that has been submitted to a task, the soonest first, below the rule."""

    def rows(source: "Sources") -> Cells:
        those = submissions().get(name, [])
        if not those:
            return []
        found = [(those[0], policy) for policy in REFERENCES]
        found += [(one, one["policy"]["name"]) for one in _ranked(those) if one["policy"]["name"] not in REFERENCES]
        return [_cells(content, policy) for content, policy in found]

    return rows


def results_note(name: str) -> Callable[["Sources"], str]:
    """Return what says how the policies do on the variations of a task."""

    def note(source: "Sources") -> str:
        from validation.pages import markdown

        those = submissions().get(name, [])
        if not those:
            made_by = f"crowd-env submit --task {name} --policy NAME --out docs/tasks/submissions"
            return f"No policy has been submitted yet: `{made_by}`."
        said = (
            f"{TASKS[name].runs} held-out draws, 95 % intervals (blocked: Wilson). The last person: of the runs that cleared; "
            "beside `rule-best-speed`: paired difference on all draws, where a run that leaves someone inside counts until the "
            "time limit."
        )
        robust = [one for one in _ranked(those) if one["robustness"] is not None]
        if not robust:
            return said
        named = [REFERENCES[0], *(one["policy"]["name"] for one in robust if one["policy"]["name"] != REFERENCES[0])]
        cells = []
        for one in variations(TASKS[name]):
            by = {
                row["policy"]: row
                for content in robust
                for row in content["robustness"]["rows"]
                if row["variation"] == one.name
            }
            cells.append([one.about, *(_short(by.get(policy)) for policy in named)])
        runs = robust[0]["robustness"]["runs"]
        below = f"\nThe first {runs} draws of each: last person of the runs that cleared, s, and blocked runs if there are any."
        return f"{said}\n\n{markdown(('variation', *(f'`{policy}`' for policy in named)), cells)}{below}"

    return note


def leaders(source: "Sources") -> Cells:
    """One row a submission, task by task, the soonest first."""
    rows = []
    for name in TASKS:
        for content in _ranked(submissions().get(name, [])):
            policy = content["policy"]
            digest = f"`{policy['sha256'][:12]}`" if policy["sha256"] else "–"
            cells = _cells(content, policy["name"])
            rows.append([f"[`{name}`]({name}.md)", cells[0], digest, *cells[1:5], _worse(content), cells[-1]])
    return rows


def leaders_note(source: "Sources") -> str:
    """Say how many there are."""
    found = submissions()
    count = sum(len(those) for those in found.values())
    return (
        f"{count} submissions to {len(found)} of {len(TASKS)} tasks; columns as on the pages of the tasks."
        if count
        else "None yet."
    )


def _ranked(those: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return submissions by the mean time of the last person, who counts until the limit if left inside; doubtful ones last."""

    def key(content: dict[str, Any]) -> tuple[bool, float]:
        policy = content["policy"]["name"]
        credible = _row(content, policy)["credible"]["ok"] is not False
        return not credible, float(np.mean(_runs(content, policy)["last_time"]))

    return sorted(those, key=key)


def _cells(content: dict[str, Any], policy: str) -> list[str]:
    row, best = _row(content, policy), REFERENCES[1]
    low, high = (100.0 * value for value in row["blocked_share"]["ci95"])
    beside = paired(*(np.array(_runs(content, name)["last_time"], dtype=np.float64) for name in (policy, best)))
    star = "" if row["pressure_is_force"] else " (no forces)"
    crushed = f"{100.0 * row['crushed_share']['mean']:.0f} %{star}"
    if row["crushed_time"]["mean"] is not None:
        crushed += f", {row['crushed_time']['mean']:.1f} s"
    said = {True: "yes", False: "**no**: " + "; ".join(row["credible"]["reasons"]), None: "not tried"}
    return [
        f"`{policy}`" + (f", {row['constants']['share']:g}" if policy == best else ""),
        f"{row['blocked']} of {row['runs']} ({low:.0f} to {high:.0f} %)",
        str(row["left"]) if row["left"] else "nobody",
        _spread(row["clearing_time"]),
        "" if policy == best else _signed(beside),
        _spread(row["mean_exit"]),
        "–" if row["flow"] is None else f"{row['flow']:.2f}",
        f"{row['contact_impulse']['mean']:.0f}",
        f"{row['max_pressure']['mean'] / 1e3:.1f}{star}",
        crushed,
        said[row["credible"]["ok"]],
    ]


def _spread(found: dict[str, Any]) -> str:
    if found["mean"] is None:
        return "–"
    low, high = found["ci95"]
    return f"{found['mean']:.1f}" if low is None else f"{found['mean']:.1f} ({low:.1f} to {high:.1f})"


def _signed(beside: dict[str, Any]) -> str:
    low, high = beside["ci95"]
    text = f"{beside['mean']:+.1f}" + ("" if low is None else f" ({low:+.1f} to {high:+.1f})")
    return text.replace("-", "−")


def _short(row: dict[str, Any] | None) -> str:
    if row is None:
        return "–"
    time = "–" if row["clearing_time"]["mean"] is None else f"{row['clearing_time']['mean']:.1f}"
    return time + (f", {row['blocked']} of {row['runs']} blocked" if row["blocked"] else "")


def _worse(content: dict[str, Any]) -> str:
    """Return the variations on which a policy blocks more runs than the rule does."""
    if content["robustness"] is None:
        return "not tried"
    blocked = {(row["variation"], row["policy"]): row["blocked"] for row in content["robustness"]["rows"]}
    policy = content["policy"]["name"]
    worse = [name for (name, who), count in blocked.items() if who == policy and count > blocked[name, REFERENCES[0]]]
    return ", ".join(worse) or "none"
