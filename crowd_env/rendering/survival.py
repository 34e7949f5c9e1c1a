"""The survival function of gaps between exits, on two logarithmic axes: where a crowd clogs, its tail is a straight line."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from crowd_env.analysis.clogging import Clogging, survival
from crowd_env.rendering.canvas import hex_of, literal, name_panel, new_figure, quiet_axes
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import INK, QUIET, SERIES

_SHORTEST = 0.02  # s, the axis does not begin earlier: gaps of people side by side say nothing of clogs


def survival_curves(sets: Mapping[str, Clogging], *, title: str = "") -> Figure:
    """Draw P(gap > t) with the fitted power law and the exponential that fits the same tail best; return the figure.

    An arrow leads from where the curve stops to the longest gap that had not ended when watching did.

    Parameters
    ----------
    sets : label -> clogging statistics, one color each.

    Raises
    ------
    ValueError
        If no set has a gap.
    """
    drawn = {label: found for label, found in sets.items() if found.gaps.closed.any()}
    if not drawn:
        raise ValueError("no gap to draw; a survival function needs two people who got out one after the other")
    figure = new_figure((6.8, 4.6 if len(drawn) == 1 else 4.7 + 0.23 * len(drawn)))
    from matplotlib.ticker import LogLocator, NullFormatter

    axes = quiet_axes(figure.add_subplot(), "gap $t$ between two people who get out [s]", "P(gap > $t$)", grid=True)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.tick_params(which="minor", color="#c9c6bf", length=2)
    axes.grid(axis="x", color="#eeece7", linewidth=0.8)
    every = [np.concatenate(found.gaps) for found in drawn.values()]
    left = max(0.8 * min(float(gaps[gaps > 0.0].min()) for gaps in every), _SHORTEST)
    right = 1.5 * max(float(gaps.max()) for gaps in every)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if right > 300.0 * left else (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    for k, (label, found) in enumerate(drawn.items()):
        _draw_one(axes, label, found, right, SERIES[k % len(SERIES)], ink=len(drawn) == 1)
    axes.set_xlim(left, right)
    axes.set_ylim(0.5 / max(len(gaps) for gaps in every), 1.5)
    name_panel(axes, literal(title))
    if any(found.tail is not None for found in drawn.values()):
        axes.plot([], [], color=hex_of(QUIET), linewidth=1.2, dashes=(4, 3), label="exponential, same tail")
    if any(_ends_open(found) for found in drawn.values()):
        axes.plot([], [], ":", marker=">", markevery=[-1], color=hex_of(QUIET), label="up to the longest open gap")
    style: dict[str, Any] = {"frameon": False, "fontsize": 9, "labelcolor": hex_of(INK), "handlelength": 2.2}
    if len(drawn) == 1:
        axes.legend(loc="upper right", **style)
    else:  # curve beside law, below the picture
        lines, labels = axes.get_legend_handles_labels()
        order = [*range(0, len(labels), 2), *range(1, len(labels), 2)]
        sorted_lines, sorted_labels = [lines[k] for k in order], [labels[k] for k in order]
        figure.legend(sorted_lines, sorted_labels, loc="outside lower center", ncols=2, **style)
    return figure


def _ends_open(found: Clogging) -> bool:
    """Whether a gap that had not ended is longer than all that had."""
    return bool(found.gaps.open.max(initial=0.0) > found.gaps.closed.max())


def _draw_one(axes: Axes, label: str, found: Clogging, right: float, color: tuple[int, int, int], *, ink: bool) -> None:
    gaps, tail = found.gaps, found.tail
    t, share = survival(gaps)
    shown = f"{literal(label)}: {len(gaps.closed)} gaps" + (f", {len(gaps.open)} open" if len(gaps.open) else "")
    seen = t > 0.0
    axes.step(t[seen], share[seen], where="post", color=hex_of(color), linewidth=2.0, label=shown, zorder=3)
    if _ends_open(found):
        end = float(gaps.open.max())
        axes.plot([t[-1], end], [share[-1]] * 2, color=hex_of(color), linewidth=1.4, linestyle=(0, (1, 1.6)), zorder=3)
        axes.plot(end, share[-1], ">", color=hex_of(color), markersize=6, zorder=4)
    if tail is None:
        axes.plot([], [], " ", label="no exponent, too few gaps")
        return
    below = int(np.searchsorted(t, tail.x_min, side="left")) - 1
    at_x_min = float(share[below]) if below >= 0 else 1.0  # P(gap >= x_min)
    x = np.geomspace(tail.x_min, max(right, 2.0 * tail.x_min), 200)
    law = at_x_min * (x / tail.x_min) ** (1.0 - tail.alpha)
    other = at_x_min * np.exp(-tail.rate * (x - tail.x_min))
    named = rf"power law, $\alpha$ = {tail.alpha:.2f} ± {tail.error:.2f} from {tail.x_min:.3g} s"
    line = INK if ink else color
    axes.plot(x, law, color=hex_of(line), linewidth=1.3, zorder=5, label=named)
    axes.plot(x, other, color=hex_of(QUIET if ink else color), linewidth=1.2, dashes=(4, 3), zorder=2)
    axes.plot(tail.x_min, at_x_min, "o", color="white", mec=hex_of(line), mew=1.3, markersize=5.5, zorder=6)
