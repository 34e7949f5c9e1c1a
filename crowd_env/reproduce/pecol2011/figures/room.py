"""Figures in the form of those of Pécol et al. 2011, ours beside theirs where they print a number."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import hex_of, mark, name_panel, new_figure, quiet_axes, series, shade
from crowd_env.rendering.palette import INK, QUIET
from crowd_env.reproduce.pecol2011.evacuations import EXPERIMENT, PRINTED, Evacuations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER_MARK: dict[str, Any] = {"marker": "D", "ls": "", "mfc": "white", "mec": "black", "mew": 1.5, "ms": 7}
# The paper's words: "the situation before contact is black, during the contact light-grey, after contact dark-grey".
_PHASES = {"before": "#000000", "during": "#b9b9b9", "after": "#5f5f5f"}


def velocity_error(
    steps: Floats,
    error: Floats,
    printed: Floats,
    mended: float,
    sweep: tuple[Floats, Floats],
    fit: tuple[float, float],
    stable: float,
) -> "Figure":
    """Return by how much the speed after a contact is wrong against the time step (Table 3).

    Parameters
    ----------
    steps, error, printed : (K,) s and m/s, ours and the paper's.
    mended : m/s, the paper's error at the last step with a zero put back.
    sweep : time steps in between and their errors.
    fit : slope and intercept of log10(error) against log10(step).
    stable : s, largest stable step.
    """
    figure = new_figure((6.4, 4.2))
    axes = quiet_axes(figure.add_subplot(), "time step $h$ [s]", r"$|u_x - 2|$ after the contact [m/s]", grid=True)
    line = np.array([steps.min(), stable])
    axes.loglog(*sweep, ".", color="#bcbab5", markersize=4, label=f"{len(sweep[0])} other steps")
    axes.loglog(line, 10 ** (fit[1] + fit[0] * np.log10(line)), color=series(0), label=f"slope {fit[0]:.2f}")
    axes.loglog(steps, error, "o", color=series(0), label="here")
    axes.loglog(steps, printed, "kx", markersize=11, label="paper, as printed")
    axes.loglog(steps[-1], mended, "k+", markersize=12, label="paper, a zero put back")
    axes.axvline(stable, color=hex_of(QUIET), dashes=(4, 3), label=rf"stable up to $2/\omega$ = {stable:.3f} s")
    axes.legend(frameon=False, fontsize=9.5, loc="upper left")
    return figure


def collisions(
    panels: Sequence[tuple[str, Sequence[tuple[float, float]], Sequence[str], tuple[float, float] | None]],
    radius: float,
) -> "Figure":
    """Return a disc that runs into the wall x = 0, in four panels (Figure 2).

    Parameters
    ----------
    panels : title, positions of the center [m] at the steps, "before", "during" or "after" the contact for each, and a position
        that was avoided or None.
    radius : m.
    """
    from matplotlib.patches import Circle

    figure = new_figure((9.6, 8.4))
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (title, positions, phases, avoided) in zip(grid.flat, panels, strict=True):
        axes.axvline(0.0, color="black", lw=2.2, zorder=1)
        axes.axvspan(-0.28, 0.0, facecolor="none", edgecolor="#d8d6d0", hatch="///", linewidth=0.0, zorder=0)
        if avoided is not None:
            axes.add_patch(Circle(avoided, radius, fill=False, ec=_PHASES["during"], ls=":", lw=1.5))
        for k, ((x, y), phase) in enumerate(zip(positions, phases, strict=True)):
            axes.add_patch(Circle((x, y), radius, fill=False, ec=_PHASES[phase], lw=1.6, zorder=3 + 0.01 * k))
            axes.plot(x, y, "o", color=_PHASES[phase], markersize=4.5, zorder=5)
            if k in (0, len(positions) - 1):
                axes.text(x + 0.05, y, f"$t$ = {0.1 * k:.1g} s", fontsize=8.5, color=_PHASES[phase], zorder=7)
        name_panel(axes, title)
        axes.set_aspect("equal")
        axes.set_xlim(-0.28, 1.2)
        axes.set_ylim(-0.88, 0.36)
        _name_axes(axes)
        axes.label_outer()
    marks = [mark(f"{phase} contact", color=color, lw=2) for phase, color in _PHASES.items()]
    marks.append(mark("avoided position (b)", color=_PHASES["during"], ls=":"))
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=10)
    return figure


def _name_axes(axes: "Axes") -> None:
    axes.set_xlabel("$x$ [m]", fontsize=10)
    axes.set_ylabel("$y$ [m]", fontsize=10)


def meetings(
    taus: Sequence[float],
    trajectories: Sequence[Floats],
    radius: float,
    form: tuple[Floats, Floats],
    recoils: Mapping[str, Floats],
) -> "Figure":
    """Return a drawing of two pedestrians who run into each other, for several tau (Figure 1).

    Parameters
    ----------
    taus : s.
    trajectories : for each tau, (T, 2, 2) m, positions of both from their first touch on, which is the same for all.
    radius : m.
    form : tau and closed form of the recoil distance.
    recoils : label -> measured recoil for each tau [m].
    """
    figure = new_figure((10.4, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=[1.75, 1.0])
    _meeting(left, taus, trajectories, radius)
    quiet_axes(right, r"relaxation time $\tau$ [s]", "recoil, exactly head-on [m]", grid=True)
    right.plot(*form, color=hex_of(INK), lw=1.3, label=r"$\tau v_d\,(1-\ln 2)$, from eq. 11")
    for (label, values), symbol, color in zip(recoils.items(), "os", (series(0), series(1)), strict=False):
        right.plot(taus, values, symbol, color=color, markersize=6.5, label=label)
    right.set_xlim(0.0, form[0][-1])
    right.set_ylim(bottom=0.0)
    right.legend(frameon=False, fontsize=9.5, loc="upper left")
    return figure


def _meeting(axes: "Axes", taus: Sequence[float], trajectories: Sequence[Floats], radius: float) -> None:
    from matplotlib.patches import Circle

    for name, side, (x, y) in zip("ij", (-1.0, 1.0), trajectories[0][0], strict=True):
        axes.add_patch(Circle((x, y), radius, fc="#f3f1ec", ec="#9b9890", lw=1.1, zorder=1))
        axes.plot([1.2 * side, x], [y, y], "ko-", lw=1.3, ms=4.5, markevery=[1], zorder=4)
        axes.text(1.27 * side, y, f"${name}$", ha="center", va="center", fontsize=13)
    for k, (tau, positions) in enumerate(zip(taus, trajectories, strict=True)):
        for who in (0, 1):
            label = None if who else rf"$\tau$ = {tau:g} s"
            axes.plot(*positions[:, who].T, color=shade(k / max(len(taus) - 1, 1)), lw=1.7, zorder=3, label=label)
    axes.set_xlim(-1.35, 1.35)
    axes.set_aspect("equal", adjustable="box")
    axes.set_ylim(-0.86, 0.86)
    _name_axes(axes)
    axes.legend(frameon=False, fontsize=9.5, loc="lower left", handlelength=1.6)


def exits_against_time(exit_times: Floats, slope: float, start: float, title: str, printed: str) -> "Figure":
    """Return how many are out against time, every run light, and one regression line (Figure 3).

    Parameters
    ----------
    exit_times : (R, N) s, nan for those still inside.
    slope, start : of the line, 1/s and people at t = 0; nan draws none.
    printed : what the paper says to it.
    """
    figure = new_figure((6.6, 4.6))
    axes = quiet_axes(figure.add_subplot(), "time [s]", "pedestrians out", title=title)
    people, known = exit_times.shape[1], exit_times[np.isfinite(exit_times)]
    # By then nearly all who got out were out: one stray at the time limit must not squeeze the rest.
    end = 1.04 * float(min(known.max(), 2.0 * np.percentile(known, 99.0))) if len(known) else 1.0
    for k, times in enumerate(np.sort(exit_times, axis=1)):
        out = np.append(times[np.isfinite(times)], end)  # people inside at the end stay
        count = np.minimum(np.arange(1.0, len(out) + 1.0), len(out) - 1)
        label = f"{len(exit_times)} simulations" if k == 0 else None
        axes.plot(out, count, color="#b4b9bf", lw=0.9, alpha=0.8, label=label, zorder=2)
    if np.isfinite(slope):
        label = f"linear regression, {slope:.2f} /s ({printed} /s)"
        axes.plot([0.0, end], [start, start + slope * end], color="black", lw=2.0, label=label, zorder=3)
    axes.set_xlim(0.0, end)
    axes.set_ylim(0.0, 1.04 * people)
    axes.legend(frameon=False, fontsize=9.5, loc="lower right")
    return figure


def flows(done: Mapping[str, Evacuations], title: str) -> "Figure":
    """Return the flow of every run under every scheme, its mean, and the paper's value (Table 5)."""
    figure = new_figure((7.6, 5.0))
    axes = quiet_axes(figure.add_subplot(), "", "flow through the door [persons/s]", title=title, grid=True)
    rng = np.random.default_rng(0)  # for offsets sideways, which keep points of similar value apart
    axes.axhline(float(EXPERIMENT), color=hex_of(QUIET), dashes=(4, 3), zorder=1, label=f"experiment {EXPERIMENT}")
    for k, (name, evacuations) in enumerate(done.items()):
        color, slopes = series(k), evacuations.slopes[np.isfinite(evacuations.slopes)]
        labels = (
            ("one draw", "mean of the draws, 95 % interval", "other estimators", "paper, Table 5")
            if k == 0
            else (None,) * 4
        )
        aside = k - 0.16 + rng.uniform(-0.13, 0.13, len(slopes))
        axes.plot(aside, slopes, ".", color=color, alpha=0.45, markersize=6, mew=0, zorder=2, label=labels[0])
        others = dict(evacuations.estimates)
        mean = others.pop("per run")
        if mean.value is not None:
            low, high = mean.ci95 or (mean.value, mean.value)
            bar = [[mean.value - low], [high - mean.value]]
            axes.errorbar(k + 0.12, mean.value, bar, fmt="o", color=color, ms=7, capsize=4, zorder=4, label=labels[1])
        values = [estimate.value for estimate in others.values() if estimate.value is not None]
        axes.plot(np.full(len(values), k + 0.24), values, "_", color=color, markersize=11, zorder=3, label=labels[2])
        axes.plot(k + 0.37, float(PRINTED[name]), **PAPER_MARK, zorder=5, label=labels[3])
    axes.set_xticks(range(len(done)), [_SPOKEN[name] for name in done], fontsize=10, color=hex_of(INK))
    axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


_SPOKEN = {"dem": "DEM", "nsm1": "NSM1\nspontaneous", "nsm1-inertial": "NSM1\ninertial", "nsm2-printed": "NSM2"}
