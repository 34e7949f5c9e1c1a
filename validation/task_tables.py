"""The tables of docs/tasks/: what each task is, how soon it could end at all, and what policies do on it, from submissions."""

from collections.abc import Iterable
from pathlib import Path

import gymnasium
import numpy as np

from crowd_env.agents import PRETRAINED, starts_from
from crowd_env.agents.evaluation.comparison import order_of, paired
from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.evaluation.submission import REFERENCES, read_submission
from crowd_env.agents.evaluation.tiers import FOLDER as TIERS_FOLDER
from crowd_env.agents.evaluation.tiers import Standing, standing
from crowd_env.agents.networks import network_digest
from crowd_env.agents.tasks import PRESETS, TASKS
from crowd_env.agents.tasks.lower_bounds import RECORDED_FLOW, exit_widths, free_walk_time, touching_flow
from crowd_env.agents.tasks.tiers import SETTINGS
from crowd_env.agents.tasks.variations import AS_IT_STANDS, variations
from crowd_env.analysis.figures import cell
from crowd_env.core.checks import Plain
from crowd_env.core.files.json_file import read_json
from crowd_env.envs.action import make_action
from validation.pages import ROOT, Rows

SUBMISSIONS = ROOT / "docs/tasks/submissions"


def _listed(values: Plain) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in values.items())


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _paid(reward: Plain) -> Plain:
    return {"prices": _listed(reward.get("weights", {})), "team_share": reward.get("team_share", 0.0)}


def tasks() -> Rows:
    """One row a task, as it is registered."""
    for task in TASKS.values():
        yield {
            "task": task,
            "harm": " (no harm)" if task.no_harm else "",
            "options": _listed(task.options),
            "last_seed": task.seeds.stop - 1,
            "varied": "; ".join(one.about for one in variations(task)[1:]),
            "digest": task.digest(),
        }


def presets() -> Rows:
    """One row a task that has a preset: what is seen, done and paid where a policy is trained for it."""
    for name, preset in ((name, PRESETS[name]) for name in TASKS if name in PRESETS):
        yield {
            "task": name,
            "preset": preset,
            "options": f"; {_listed(preset.options)}" if preset.options else "",
            "terms": _quoted(TASKS[name].terms),
            "action": action if isinstance(action := TASKS[name].action, str) else action["name"],
            **_paid(TASKS[name].reward or {}),
        }


def floors() -> Rows:
    """One row a task: how soon the last could be out alone, one behind the other, and at the flow of recorded people."""
    for name, task in TASKS.items():
        place, alone = task.place(), free_walk_time(task)
        width, touching = float(exit_widths(place).sum()), task.people / touching_flow(place)
        recorded = task.people / (RECORDED_FLOW * width)
        times = {"floor": max(alone, touching), "alone": alone, "touching": touching, "recorded": recorded}
        yield {"task": name, "width": width, **times}


def tiers(folder: Path = ROOT / "docs/tasks/tiers") -> Rows:
    """One row a setting of the benchmark: its bound, and how near to it the best known policies are."""
    for one in SETTINGS:
        there = standing(one, folder)
        alike = one.variation is AS_IT_STANDS or one.variation.about.startswith("the task")
        yield {
            "setting": one,
            "about": "as it stands" if alike else one.variation.about,
            **(_stands(there) if there else dict.fromkeys(_STANDS, "not tried")),
        }


_STANDS = ("bound", "best", "half", "gap", "rule", "hindsight")


def _stands(one: Standing) -> dict[str, str]:
    def told(left: int, time: float) -> str:
        return ("never" if np.isinf(time) else f"{time:.1f}") + (f", left in {left}" if left else "")

    return {
        "bound": f"{one.bound:.1f}",
        "best": f"`{one.best}`",
        "half": told(one.best_left, one.best_time),
        "gap": "–" if np.isinf(one.gap) else f"{100.0 * one.gap:+.0f} %".replace("-", "−"),
        "rule": f"{told(one.rule_left, one.rule_time)} (`{one.rule}`)",
        "hindsight": told(0, one.hindsight),
    }


# ----------------------------------------------------------------------------------------------------------- submissions


def read_submissions(folder: Path = SUBMISSIONS) -> dict[str, list[Plain]]:
    """Return the submissions in a folder by task, every one held against its task.

    Doubtful ones stand last, the others in the order of `crowd_env.agents.evaluation.comparison.order_of`: of the last person's
    time, or in a selfish task of the mean exit of the people that the policy moves.

    Raises
    ------
    ValueError
        If one does not fit its task, or two are of one policy.
    """
    found: dict[str, list[Plain]] = {name: [] for name in TASKS}
    for path in sorted(folder.glob("*/*.json")):
        one = read_submission(path)
        mine, those = one["policy"]["name"], found[one["task"]["name"]]
        if mine in [other["policy"]["name"] for other in those]:
            raise ValueError(f"{path}: {mine} has been submitted twice")
        those.append(one)
    for those in found.values():
        those.sort(key=lambda one: (_row(one)["credible"]["ok"] is False, order_of(payoffs_of(one))))
    return {name: those for name, those in found.items() if those}


def _times(content: Plain, policy: str = "", column: str = "last_time") -> np.ndarray:
    """Return when the last person of each run was out [s], or another column; nan where people were left inside."""
    named = (policy or content["policy"]["name"], "task")
    found = next(one for one in content["runs"] if (one["policy"], one["variation"]) == named)
    return np.array(found[column], dtype=np.float64)


def payoffs_of(content: Plain) -> np.ndarray:
    """Return the times [s] that order the policies of a task, see `read_submissions`."""
    task = TASKS[content["task"]["name"]]
    own = "mean_exit" if task.learned_share is None else "mean_exit_learned"
    return _times(content, column=own if task.selfish else "last_time")


def _row(content: Plain, policy: str = "") -> Plain:
    return dict(next(row for row in content["rows"] if row["policy"] == (policy or content["policy"]["name"])))


def submissions(folder: Path = SUBMISSIONS) -> Rows:
    """One row a policy, task by task: the rule at full and at its best speed, then what was submitted, the best first."""
    for name, those in read_submissions(folder).items():
        ours = [(those[0], policy) for policy in REFERENCES]
        ours += [(one, one["policy"]["name"]) for one in those if one["policy"]["name"] not in REFERENCES]
        yield from ({"task": name, **_judged(content, policy)} for content, policy in ours)


def _judged(content: Plain, policy: str) -> Plain:
    row, own, best = _row(content, policy), content["own"][-1], REFERENCES[1]
    later = paired(_times(content, policy), _times(content, best))
    credible = {True: "yes", False: "**no**: " + "; ".join(row["credible"]["reasons"]), None: "not tried"}
    is_ours, is_best = policy in REFERENCES, policy == best
    network = "" if is_ours else content["policy"]["sha256"]
    return {
        **row,
        "mean_exit": row.get("mean_exit_learned", row["mean_exit"]),
        "policy": policy,
        "share": f", {row['constants']['share']:g}" if is_best else "",
        "start": "–" if network and policy not in PRETRAINED else starts_from(policy),
        "network": f"`{network[:12]}`" if network else "" if is_ours else "–",
        "inside": row["left"] or "nobody",
        "own": "" if is_ours else cell("{clearing_time[mean]:.1f}", own) + _lost(own),
        "beside": "" if is_best else cell("{mean:+.1f} ({ci95[0]:+.1f} to {ci95[1]:+.1f})", later),
        "more_left": "" if is_best else cell("{more_left:+d}", later),
        "star": "" if row["pressure_is_force"] else " (no forces)",
        "crushed": "" if row["crushed_time"]["mean"] is None else cell(", {crushed_time[mean]:.1f} s", row),
        "worse": "" if is_ours else _worse(content),
        "judged": credible[row["credible"]["ok"]],
    }


def _lost(row: Plain) -> str:
    return f", left in {row['unfinished']} of {row['runs']}" if row["unfinished"] else ""


def _worse(content: Plain) -> str:
    """Return the variations on which a policy leaves people inside in more draws than the rule does."""
    if content["robustness"] is None:
        return "not tried"
    left = {(row["variation"], row["policy"]): row["unfinished"] for row in content["robustness"]["rows"]}
    mine = content["policy"]["name"]
    tried = [name for name, policy in left if policy == mine]
    return ", ".join(name for name in tried if left[name, mine] > left[name, REFERENCES[0]]) or "none"


def cards(folder: Path = SUBMISSIONS) -> Rows:
    """One row a shipped policy: what it sees and does, how it was trained, its digest, its figures and its limits."""
    judged = {one["policy"]["name"]: one for those in read_submissions(folder).values() for one in those}
    return [_card(name, read_json(path.with_suffix(".json")), judged.get(name)) for name, path in PRETRAINED.items()]


def _card(name: str, made: Plain, judged: Plain | None) -> Plain:
    config, spent, action = made["config"], made["spent"], make_action(made["config"]["action"])
    figures, limits = "not submitted", "unchecked"
    trained = f"{config['people']} people, `{config['scenario']}`: {_listed(config['options'])}; `{config['scheme']}`, "
    trained += f"{config['dt']:g} s"
    if places := config.get("places"):
        trained = f"generated places of up to {places['people']} people and those of the tasks, under their laws"
        figures, limits = "[generated places](training.md#one-policy-for-every-place); the pages of the tasks", "there"
    elif judged is not None:
        row, worse = _row(judged), _worse(judged)
        told = "half of all draws {median_time:half} s; left somebody inside in {unfinished} of {runs}"
        figures = cell(told, row) + cell("; above 1.6 kN/m {crushed_share[mean]:%} %", row)
        known = ", ".join(_known_limits(judged)) or "none"
        limits = f"leaves people in more draws than the rule on: {worse}; 10 % slower than the rule on: {known}; "
        limits += _elsewhere(name)
    between = "between two of " if places else ""
    choices = f", {between}{action.space.n} choices" if isinstance(action.space, gymnasium.spaces.Discrete) else ""
    return {
        **made,
        "card": name.replace("/", "-"),
        "policy": name,
        "digest": network_digest(PRETRAINED[name]),
        "seen": config["observation"],
        "terms": _quoted(config["observation"]["terms"]),
        "action": action.name,
        "choices": choices,
        "trained": trained,
        "start": starts_from(name),
        **_paid(config["reward"]),
        "steps": spent["steps"] / 1e6,
        "figures": figures,
        "limits": limits,
        "brought": _brought(made["confirmation"]),
    }


def _brought(found: Plain | None) -> str:
    """Return what PPO brought beside its start, on fresh draws."""
    if found is None or "draws" not in found:
        return "not recorded"
    text = "{seconds_later:+.2f} ± {error:.2f} s, contacts {impulse_more:+.0f} N s a person (95 %, {draws} draws)"
    return cell(text, {**found, "error": 1.96 * found["standard_error"]})


def _elsewhere(name: str, folder: Path = ROOT / TIERS_FOLDER) -> str:
    """Return how a policy fares beside the rule in the tasks of the tiers that are not its own."""
    ratios, worse = [], []
    for one in SETTINGS:
        if one.variation is not AS_IT_STANDS or one.task.name == name.partition("/")[0]:
            continue
        rows = read_json(folder / f"{one.title}.json")["rows"]
        if name in rows:
            (left, own), (of_rule, rule) = (
                order_of(np.array(rows[who]["last_time"], dtype=np.float64)) for who in (name, RULE)
            )
            ratios += [own / rule] if np.isfinite([own, rule]).all() else []
            worse += [one.task.name] if left > of_rule else []
    if not ratios:
        return "other tasks than its own: not tried"
    span = " to ".join(dict.fromkeys(f"{one:.2f}" for one in (min(ratios), max(ratios))))
    told = f"elsewhere {span} times the time of the rule (tried where the rule clears: {len(ratios)})"
    return told + (f", leaves people in more draws in: {', '.join(worse)}" if worse else "")


def _known_limits(content: Plain) -> list[str]:
    """Return the variations on which half of a policy's draws are over 10 % later than half of the rule's."""
    rows = () if content["robustness"] is None else content["robustness"]["rows"]
    half = {(row["variation"], row["policy"]): row["median_time"] for row in rows}
    mine = content["policy"]["name"]
    pairs = {name: (half[name, mine], half[name, REFERENCES[0]]) for name, policy in half if policy == mine}
    return [name for name, (own, rule) in pairs.items() if rule is not None and (own is None or own > 1.1 * rule)]


def varied(folder: Path = SUBMISSIONS) -> Rows:
    """One row a task, variation and policy: when half of all draws were over, and those with people left."""
    for name, those in read_submissions(folder).items():
        about = {one.name: one.about for one in variations(TASKS[name])}
        for row in (row for one in those if one["robustness"] is not None for row in one["robustness"]["rows"]):
            yield {**row, "task": name, "about": about[row["variation"]], "left": _lost(row)}
