"""Is a result of people who walk, or of bodies that pass through each other: held against the rule under the same scheme.

A policy is to order a crowd, not to find a hole in the physics.  Every scheme has overlaps of its own, speeds of people who are
pushed, and a flow, so that no number holds for all of them: what the rule does at full speed, on the same draws, is what the
scheme makes of a crowd that does its worst.
"""

from collections.abc import Sequence

from crowd_env import Scenario

from ..plain import Plain
from ..tasks.lower_bounds import LARGEST_RECORDED_FLOW, exit_widths, touching_flow
from ..walking import RuleAtShare
from .entries import RULE

_OVERLAP, _OVERLAP_MM = 1.25, 1.0  # the deepest of many draws scatters: so many times the rule's, and so much more
_SPEED, _FLOW, _HURRY = 1.25, 1.1, 1.05  # times what is allowed


def credibility(row: Plain, rows: Sequence[Plain], place: Scenario) -> Plain:
    """Return whether what a policy did can be believed: ``ok`` and the ``reasons``, ready for JSON.

    Nobody may have escaped.  The deepest overlap and the largest speed of anyone may be a quarter more than under the rule at
    full speed; nobody may walk faster than desired on average, or 5 % faster than anyone who is pushed on under the rule.  The
    flow may be a tenth more than people reach (2.8 a second and meter of exit, `crowd_env.agents.tasks.lower_bounds`), or
    than the rule does at its best; where that leaves someone inside in half of its runs, than people one behind the other,
    touching, at full speed.

    Parameters
    ----------
    row, rows : as `Evaluation.row` returns them, measured, of this policy and of all policies on the same draws; without the
        rule among those under the same scheme ``ok`` is None unless something is wrong in itself.
    """
    beside = [one for one in rows if one["scheme"] == row["scheme"]]
    rule = next((one for one in beside if one["policy"] == RULE), None)
    reasons = [f"{row['escaped']} people were outside of the walls"] if row["escaped"] else []
    if rule is not None:
        best = [one for one in beside if one["policy"] in (RULE, RuleAtShare.name)]
        reasons += [
            f"{name} is {value:.3g}{unit}, more than {most:.3g}{unit}: {because}"
            for name, value, most, unit, because in _checks(row, rule, best, place)
            if value > most
        ]
    elif not reasons:
        return {"ok": None, "reasons": [f"not held against the rule: it is not among the policies (add {RULE})"]}
    return {"ok": not reasons, "reasons": reasons}


def _checks(
    row: Plain, rule: Plain, best: Sequence[Plain], place: Scenario
) -> list[tuple[str, float, float, str, str]]:
    """Return what is checked: name, value, the most that is believed, its unit, and why."""
    wanted = max(part.desired_speed.high for part in place.population.parts)
    overlap, speed = _OVERLAP * 1e3 * rule["max_overlap"] + _OVERLAP_MM, _SPEED * max(rule["max_speed"], wanted)
    hurry = _HURRY * max(1.0, rule["hurry"]["max"])
    flow, whose = _largest_flow(best, place)
    own = "the rule's with 5 % more, at least 1"
    return [
        ("the deepest overlap", 1e3 * row["max_overlap"], overlap, " mm", "a quarter and 1 mm more than the rule's"),
        ("the largest speed", row["max_speed"], speed, " m/s", "a quarter more than the rule's, or than desired"),
        ("someone's mean speed over the desired", row["hurry"]["max"], hurry, "", own),
        ("the flow", row["flow"]["mean"] or 0.0, _FLOW * flow, " /s", f"a tenth more than {whose}"),
    ]


def _largest_flow(best: Sequence[Plain], place: Scenario) -> tuple[float, str]:
    """Return the largest flow [1/s] that is believed, without tolerance, and whose it is."""
    width = float(exit_widths(place).sum())
    flows = {
        f"the largest recorded through {width:.3g} m of exits": LARGEST_RECORDED_FLOW * width,
        "the rule's at its best": max((row["flow"]["mean"] or 0.0 for row in best), default=0.0),
    }
    if min((row["unfinished_runs"] / row["runs"] for row in best), default=0.0) >= 0.5:
        flows["people one behind the other, touching, at full speed (the rule gets stuck)"] = touching_flow(place)
    whose = max(flows, key=lambda name: flows[name])
    return flows[whose], whose
