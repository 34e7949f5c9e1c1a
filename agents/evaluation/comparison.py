"""Policies beside each other on the same draws: paired differences, and whether their order depends on the contact scheme."""

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

from crowd_env.analysis.figures import median_time
from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.json_file import json_number
from crowd_env.envs.metrics import summarise

from ..plain import Plain
from .evaluation import Evaluation


def last_times(result: Evaluation) -> Floats:
    """Return when the last person of each run was out (runs,) [s]; people who did not get out count as in `times_of_all`."""
    return result.times_of_all().max(axis=1)


def mean_times(result: Evaluation) -> Floats:
    """Return the mean exit time of each run (runs,) [s]; people who did not get out count as in `times_of_all`."""
    return result.times_of_all().mean(axis=1)


def clearing_times(result: Evaluation) -> Floats:
    """Return when the last person of each run was out (runs,) [s]; nan where somebody was left inside."""
    return np.array(result.exit_times).max(axis=1)


def rounded(times: Floats) -> list[float | None]:
    """Return times [s] ready for JSON, to a thousandth; None for nan."""
    return [json_number(round(float(one), 3)) for one in times]


def clearing_means(result: Evaluation) -> Floats:
    """Return the mean exit time of each run (runs,) [s]; nan where somebody was left inside."""
    return np.array(result.exit_times).mean(axis=1)


def paired(one: Floats, other: Floats) -> Plain:
    """Return how much longer ``one`` took than ``other``, run by run on the same draws; nan: somebody was left inside.

    ``mean`` and ``ci95`` are of the difference in the ``draws`` that both cleared (t interval over them); ``faster`` is the
    share of these in which ``one`` took less, where a tie counts half.  In ``more_left`` more draws of ``one`` than of the
    other somebody was left inside: no time limit stands for a time.

    Raises
    ------
    ValueError
        If the numbers of runs differ.
    """
    if len(one) != len(other) or not len(one):
        raise ValueError(f"{len(one)} and {len(other)} runs cannot be paired")
    difference = np.asarray(one, dtype=np.float64) - other
    difference = difference[np.isfinite(difference)]
    summary = summarise(difference)
    return {
        "mean": json_number(summary.mean),
        "ci95": [json_number(bound) for bound in summary.ci95],
        "faster": float(((difference < 0) + 0.5 * (difference == 0)).mean()) if len(difference) else None,
        "draws": len(difference),
        "more_left": int(np.isnan(one).sum() - np.isnan(other).sum()),
    }


def minus_first(result: Evaluation, first: Evaluation) -> Plain:
    """Return the paired differences of a policy to the first one under the same scheme."""
    return {
        "policy": first.policy,
        "evacuation_time": paired(clearing_times(result), clearing_times(first)),
        "mean_exit_time": paired(clearing_means(result), clearing_means(first)),
    }


def by_scheme(results: Sequence[Evaluation]) -> dict[str, list[Evaluation]]:
    """Return the results under each scheme."""
    return {
        name: [one for one in results if one.scheme == name] for name in dict.fromkeys(one.scheme for one in results)
    }


def rows_beside(results: Sequence[Evaluation]) -> list[Plain]:
    """Return the `Evaluation.row` of each result with its differences to the first policy under its scheme."""
    first = {one.scheme: one for one in reversed(results)}
    return [{**one.row(), "minus_first": minus_first(one, first[one.scheme])} for one in results]


def ratio(result: Evaluation, first: Evaluation) -> float | None:
    """Return the mean time of the last person over that of another policy on the same draws; None if anyone was left inside."""
    if result.column("unfinished").any() or first.column("unfinished").any():
        return None
    return float(last_times(result).mean() / last_times(first).mean())


def kendall_tau(one: Sequence[float], other: Sequence[float]) -> float | None:
    """Return Kendall's tau-b of two lists of values, which allows for ties; None if one of them says nothing."""
    pairs = list(combinations(range(len(one)), 2))
    a = np.sign([one[j] - one[i] for i, j in pairs])
    b = np.sign([other[j] - other[i] for i, j in pairs])
    norm = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum()) / norm if norm > 0 else None


def order_of(times: Floats) -> tuple[int, float]:
    """Return by what policies stand in order, from times (runs,) [s]: fewer runs with somebody left (nan), the lower median."""
    half = median_time(times)
    return int(np.isnan(times).sum()), np.inf if half is None else half


def ranking(results: Sequence[Evaluation], *, of: Callable[[Evaluation], Floats] = clearing_times) -> Plain:
    """Return the order of the policies under every scheme, that of `order_of`, and how far the schemes agree.

    ``schemes`` holds the ``order`` with the median ``times`` [s] of all runs, ``tau`` Kendall's tau-b of each pair of schemes,
    ``same`` whether the order is the same under all.  ``contradictions`` lists the pairs of policies of which one is clearly
    faster under one scheme and clearly slower under another: the paired 95 % intervals are on opposite sides of zero.

    Parameters
    ----------
    results : every policy under every scheme.
    of : the times (runs,) [s] of an evaluation that are compared, nan where somebody was left inside.
    """
    table = {scheme: {one.policy: of(one) for one in some} for scheme, some in by_scheme(results).items()}
    keys = {scheme: {name: order_of(times) for name, times in row.items()} for scheme, row in table.items()}
    orders = {scheme: sorted(row, key=lambda name, row=row: row[name]) for scheme, row in keys.items()}  # type: ignore[misc]
    names = list(next(iter(keys.values()), {}))
    ranks = {scheme: [sorted(row.values()).index(row[name]) for name in names] for scheme, row in keys.items()}
    taus = {f"{a} {b}": kendall_tau(ranks[a], ranks[b]) for a, b in combinations(keys, 2)}
    halves = {scheme: {name: json_number(half) for name, (_, half) in row.items()} for scheme, row in keys.items()}
    return {
        "schemes": {scheme: {"order": orders[scheme], "times": halves[scheme]} for scheme in keys},
        "tau": taus,
        "same": all(tau is None or tau == 1.0 for tau in taus.values())
        and len({tuple(o) for o in orders.values()}) == 1,
        "contradictions": _contradictions(table, names),
    }


def _contradictions(table: Mapping[str, Mapping[str, Floats]], names: Sequence[str]) -> list[Plain]:
    found: list[Plain] = []
    for one, other in combinations(names, 2):
        bounds = {scheme: paired(row[one], row[other])["ci95"] for scheme, row in table.items()}
        faster = [scheme for scheme, (_, high) in bounds.items() if high is not None and high < 0.0]
        slower = [scheme for scheme, (low, _) in bounds.items() if low is not None and low > 0.0]
        if faster and slower:
            found.append({"policies": [one, other], "first_faster_under": faster, "second_faster_under": slower})
    return found
