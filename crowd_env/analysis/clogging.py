"""How a crowd clogs: the gaps between people who get out one after the other, their bursts, and the tail of the gaps.

Where exits clog, long gaps are far more frequent than chance makes them: p(gap) ~ gap^-alpha.  With alpha <= 2 the mean gap
diverges: that is the clogged state of Zuriguel et al., Scientific Reports 4 (2014) 7324, of sheep, people, grains and colloids
alike.  The tail is fitted as Clauset, Shalizi, Newman, SIAM Review 51 (2009) 661 do it.

Gaps lie between exits: the wait for the first person is none.  If someone is still inside when watching ends, the last gap is
OPEN: longer than what was seen of it.  Open gaps are neither dropped nor taken for closed ones: they are counted, the survival
function knows that they are longer (Kaplan, Meier 1958), and an exponent that knows it too stands beside the plain one.
"""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.analysis.figures import number, percent, share
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.files.json_file import json_number

FEWEST_GAPS = 50  # with fewer there is no exponent
FEWEST_IN_TAIL = 10
CLOGGED = 2.0  # from this exponent down the mean gap diverges


class RunExits(NamedTuple):
    """When people got out of one place."""

    time: Floats  # (K,)  s, increasing
    exit: np.ndarray  # (K,)  name or number of the exit that each took
    until: float = np.nan  # s     when watching ended with someone still inside; nan: everyone got out


class Gaps(NamedTuple):
    """Times between successive exits."""

    closed: Floats  # (G,)  s
    open: Floats  # (O,)  s, what was seen of gaps that had not ended: they are longer


class Tail(NamedTuple):
    """The power law p(gap) ~ gap^-alpha, gap >= x_min, of the closed gaps."""

    alpha: float
    error: float  # (alpha - 1) / sqrt(n); x_min counts as known
    x_min: float  # s    where the law fits best
    n: int  # gaps in the tail
    distance: float  # of Kolmogorov and Smirnov, between the tail and the law
    rate: float  # 1/s  of the exponential that fits the same tail best
    ratio: float  # log-likelihood ratio, > 0: the power law is likelier than the exponential
    p: float  # of a ratio so far from 0 if neither were likelier (Vuong)
    alpha_open: float  # exponent at the same x_min if the open gaps count as "longer than this"; nan if there are none


class Clogging(NamedTuple):
    """The clogging statistics of one or many runs; nothing in it depends on their order."""

    runs: int
    exits: int  # pedestrians that got out
    unfinished: int  # runs that were watched until some time with people still inside
    blocked: int  # of these, runs in which nobody had got out for `blocked_after`
    gaps: Gaps  # of all runs, sorted
    bursts: Ints  # (B,)  sizes, sorted: people who got out with gaps below `pause`
    pause: float  # s
    tail: Tail | None
    no_tail: str  # why there is no exponent, or ""

    def statement(self) -> str:
        """Return in words what the exponent says, and how far it can be believed."""
        blocked = f"{self.blocked} of {self.runs} runs blocked, with gaps longer than anyone waited for"
        if self.tail is None:
            return f"no exponent: {self.no_tail}" + (f"; {blocked}" if self.blocked else "")
        if self.blocked and np.isfinite(self.tail.alpha_open):
            blocked += f" (alpha = {self.tail.alpha_open:.2f} if these count as longer)"
        return _read_tail(self.tail, blocked if self.blocked else "")

    def as_json(self) -> dict[str, Any]:
        """Return the figures ready for JSON: times in s, None where there is no number."""
        (closed, opened), bursts = self.gaps, self.bursts
        sizes, counts = np.unique(bursts, return_counts=True)
        return {
            "runs": self.runs,
            "exits": self.exits,
            "unfinished_runs": self.unfinished,
            "blocked_runs": self.blocked,
            "blocked_share": share(self.blocked, self.runs),
            "gaps": {
                "count": len(closed),
                "mean": float(closed.mean()) if len(closed) else None,
                "cv": float(closed.std() / closed.mean()) if closed.any() else None,
                "q90": float(np.quantile(closed, 0.9)) if len(closed) else None,
                "max": max(closed.tolist(), default=None),
                "open": len(opened),
                "longest_open": max(opened.tolist(), default=None),
            },
            "bursts": {
                "pause": self.pause,
                "count": len(bursts),
                "mean_size": float(bursts.mean()) if len(bursts) else None,
                "max_size": max(bursts.tolist(), default=None),
                "sizes": {str(size): count for size, count in zip(sizes, counts.tolist(), strict=True)},
            },
            "tail": None if self.tail is None else {key: json_number(x) for key, x in self.tail._asdict().items()},
            "no_tail": self.no_tail or None,
            "clogged": None if self.tail is None else bool(self.tail.alpha <= CLOGGED),
            "statement": self.statement(),
        }


def exits_of_run(exit_time: ArrayLike, until: float = np.nan, exit: ArrayLike | None = None) -> RunExits:
    """Return a run from the exit times (N,) [s] of its people, in any order; nan for a pedestrian left inside.

    Parameters
    ----------
    until : s, when watching ended; needed if someone did not get out.
    exit : (N,), name or number of the exit that each took; default the same for all.

    Raises
    ------
    ValueError
        If a time is infinite, or watching ended before the last exit, or that time is missing.
    """
    time = np.asarray(exit_time, dtype=np.float64).reshape(-1)
    taken = np.zeros(len(time), dtype=np.int64) if exit is None else np.asarray(exit).reshape(-1)
    if len(taken) != len(time):
        raise ValueError(f"{len(taken)} exits but {len(time)} exit times")
    out = ~np.isnan(time)
    if np.isinf(time).any():
        raise ValueError("an exit time is infinite; it must be finite, or nan for someone who did not get out")
    order = np.argsort(time[out], kind="stable")
    time, taken, everyone = time[out][order], taken[out][order], bool(out.all())
    if everyone:
        return RunExits(time, taken)
    if not np.isfinite(until) or (len(time) and until < time[-1]):
        raise ValueError(f"someone did not get out, and watching ended at {until!r} s; say when, after the last exit")
    return RunExits(time, taken, float(until))


def exit_gaps(run: RunExits, *, per_exit: bool = False) -> Gaps:
    """Return the gaps between successive exits of a run: of all people, or of those who took the same exit.

    An unused exit has no gap, not even an open one.
    """
    series = _series(run, per_exit)
    closed = [np.diff(times) for times in series]
    opened = [run.until - times[-1] for times in series if np.isfinite(run.until)]
    return Gaps(np.concatenate([np.empty(0), *closed]), np.array(opened, dtype=np.float64))


def burst_sizes(gaps: ArrayLike, pause: float) -> Ints:
    """Return how many people each burst holds: a burst goes on while the ``gaps`` (G,) [s] are below ``pause`` [s].

    ``gaps`` are those of one run (and exit) in their order: G gaps lie between G + 1 people.
    """
    ends = np.flatnonzero(np.asarray(gaps, dtype=np.float64) >= pause)
    return np.diff(np.concatenate([[-1], ends, [np.size(gaps)]])).astype(np.int64)


def survival(gaps: Gaps) -> tuple[Floats, Floats]:
    """Return the distinct closed gaps t (K,) [s] and P(gap > t) (K,): Kaplan and Meier's estimate.

    Without open gaps it is the share of gaps that are longer than t; with them it ends above 0.
    """
    t, ended = np.unique(gaps.closed, return_counts=True)
    lasting = np.sort(np.concatenate(gaps))
    as_long = len(lasting) - np.searchsorted(lasting, t, side="left")  # gaps not shorter than t
    return t, np.asarray(np.cumprod(1.0 - ended / as_long), dtype=np.float64)


def clogging(
    runs: Sequence[RunExits], *, pause: float = 2.0, per_exit: bool = False, blocked_after: float = 120.0
) -> Clogging:
    """Return the clogging statistics of one or many runs.

    Parameters
    ----------
    pause : s, a gap so long or longer ends a burst.
    per_exit : take the gaps between people who took the same exit.
    blocked_after : s, an unfinished run without anyone getting out for longer than this counts as blocked.

    Raises
    ------
    ValueError
        If there is no run, or ``pause`` or ``blocked_after`` is not positive.
    """
    if not runs:
        raise ValueError("no runs; clogging statistics need at least one")
    for name, value in (("pause", pause), ("blocked_after", blocked_after)):
        if not value > 0:
            raise ValueError(f"{name} is {value!r} s; it must be > 0")
    found = [exit_gaps(run, per_exit=per_exit) for run in runs]
    pooled = Gaps(*(np.sort(np.concatenate(parts)) for parts in zip(*found, strict=True)))
    bursts = [burst_sizes(np.diff(times), pause) for run in runs for times in _series(run, per_exit)]
    waits = [run.until - (run.time[-1] if len(run.time) else 0.0) for run in runs]  # nan where everyone got out
    tail, reason = fit_tail(pooled)
    return Clogging(
        runs=len(runs),
        exits=sum(len(run.time) for run in runs),
        unfinished=int(np.isfinite(waits).sum()),
        blocked=int(np.sum(np.array(waits) > blocked_after)),
        gaps=pooled,
        bursts=np.sort(np.concatenate([np.empty(0, dtype=np.int64), *bursts])),
        pause=pause,
        tail=tail,
        no_tail=reason,
    )


def fit_tail(gaps: Gaps) -> tuple[Tail | None, str]:
    """Return the power law that fits the tail of the closed gaps best, or None and the reason."""
    closed = gaps.closed[gaps.closed > 0.0]
    if len(closed) < FEWEST_GAPS:
        return None, f"{len(closed)} gaps above 0 s, an exponent needs at least {FEWEST_GAPS}"
    if len(np.unique(closed)) < FEWEST_IN_TAIL:
        return None, f"the gaps have {len(np.unique(closed))} lengths, an exponent needs at least {FEWEST_IN_TAIL}"
    try:
        import powerlaw  # brings scipy and matplotlib
    except ModuleNotFoundError as missing:
        return None, f"it needs {missing.name}, which is not installed: pip install {missing.name}"
    # Left alone, powerlaw prints, draws a progress bar, and reports an exponent of 3 for every steeper tail.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = powerlaw.Fit(np.sort(closed), verbose=0, parameter_ranges={"alpha": (1.0, None)})
        law, other = fit.power_law, fit.exponential
        ratio, p = fit.distribution_compare("power_law", "exponential")
    count, alpha, x_min = int(fit.n_tail), float(law.alpha), float(fit.xmin)
    if count < FEWEST_IN_TAIL:
        return None, f"{count} gaps in the tail (from {x_min:.3g} s), an exponent needs at least {FEWEST_IN_TAIL}"
    error = float((alpha - 1.0) / np.sqrt(count))
    told = map(float, (law.D, other.Lambda, ratio, p, _alpha_of_censored(gaps, x_min)))
    return Tail(alpha, error, x_min, count, *told), ""


def _series(run: RunExits, per_exit: bool) -> list[Floats]:
    """Return the exit times whose gaps count: of the whole run, or of each exit that somebody took."""
    if not len(run.time):
        return []
    return [run.time[run.exit == name] for name in np.unique(run.exit)] if per_exit else [run.time]


def _alpha_of_censored(gaps: Gaps, x_min: float) -> float:
    """Return the likeliest exponent of closed gaps together with open ones that are known to be longer; nan without these."""
    opened = gaps.open[gaps.open > x_min]
    if not len(opened):
        return float("nan")
    tail = gaps.closed[gaps.closed >= x_min]
    return float(1.0 + len(tail) / (np.log(tail / x_min).sum() + np.log(opened / x_min).sum()))


def _read_tail(tail: Tail, blocked: str) -> str:
    said = f"alpha = {tail.alpha:.2f} ± {tail.error:.2f} "
    if tail.alpha <= CLOGGED:
        said += f"<= {CLOGGED:g}: the mean gap diverges, the clogged state of Zuriguel et al. 2014"
    elif blocked:
        said += f"> {CLOGGED:g}: the mean of the gaps that ended is finite"
    else:
        said += f"> {CLOGGED:g}: the mean gap is finite, no clogged state in the sense of Zuriguel et al. 2014"
    if abs(tail.alpha - CLOGGED) < 2.0 * tail.error:
        said += f" (but within two standard errors of {CLOGGED:g})"
    if blocked:
        said += f"; {blocked}"
    if tail.p > 0.1:
        return said + f"; the tail is not told apart from an exponential (p = {tail.p:.2f})"
    if tail.ratio < 0.0:
        return said + "; an exponential fits the tail better: no power law"
    return said


def cells(found: Clogging) -> dict[str, str]:
    """Return the rows of a table, label -> cell."""
    figures = found.as_json()
    gaps, bursts, tail = figures["gaps"], figures["bursts"], figures["tail"] or {}
    opened = f", longest above {gaps['longest_open']:.1f} s" if gaps["open"] else ""
    return {
        "runs": str(found.runs),
        "  unfinished, of these blocked": f"{found.unfinished}, {found.blocked}",
        "  share blocked, 95 %": f"{percent(figures['blocked_share'])} %",
        "people out": str(found.exits),
        "gaps": str(gaps["count"]),
        "  mean": number(gaps["mean"], "s"),
        "  standard deviation / mean": number(gaps["cv"]),
        "  90 % are below": number(gaps["q90"], "s"),
        "  longest": number(gaps["max"], "s"),
        "  open at the end": f"{gaps['open']}{opened}",
        f"bursts (gaps below {found.pause:g} s)": str(bursts["count"]),
        "  mean size": number(bursts["mean_size"], "people"),
        "  largest": number(bursts["max_size"], "people", 0),
        "exponent of the tail": number(tail.get("alpha")) + (f" ± {tail['error']:.2f}" if tail else ""),
        "  if open gaps count as longer": number(tail.get("alpha_open")),
        "  from (x_min)": number(tail.get("x_min"), "s"),
        "  gaps in the tail": number(tail.get("n"), digits=0),
        "  Kolmogorov-Smirnov distance": number(tail.get("distance"), digits=3),
        "  log-likelihood ratio to an exponential": number(tail.get("ratio"), digits=1),
        "    p": number(tail.get("p"), digits=3),
    }
