"""Several sets of evacuations in one figure: N(t) with bands over draws, and the shares of the exits with intervals."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, save_figure, series
from crowd_env.rendering.palette import INK

_WIDTH = 6.0  # inch
_DPI = 200


class Band(NamedTuple):
    """N(t) of a set of evacuations."""

    time: Floats  # (T,)  s
    mean: Floats  # (T,)
    low: Floats  # (T,)  lower edge of the band
    high: Floats  # (T,)
    until: float = np.inf  # s  beyond this it is not known how many are inside


class Share(NamedTuple):
    """A mean share with its interval; nan where there is none."""

    mean: float
    low: float
    high: float


def _shown(label: str) -> str:
    """Return a label that a legend leaves out in no case."""
    return f" {label}" if label.startswith("_") else label


def egress_bands(path: str | Path, bands: Mapping[str, Band]) -> Path:
    """Draw how many people are inside against time, a line and a band for each label, and return the path.

    Parameters
    ----------
    path : ends in .png.
    bands : label -> N(t); each is continued by its last values to the end of the longest, as far as that is known.

    Raises
    ------
    ValueError
        If the suffix is another, or there is no band.
    """
    if not bands:
        raise ValueError("egress curves need at least one band")
    figure = new_figure((_WIDTH, 3.4 + 0.22 * len(bands)), dpi=_DPI)
    axes = quiet_axes(figure.add_subplot(), "time [s]", "people inside", grid=True)
    end = 1.03 * max(max(float(band.time[-1]) for band in bands.values()), 1e-3)
    for k, (label, band) in enumerate(bands.items()):
        time, mean, low, high = (np.append(row, row[-1]) for row in band[:4])
        time[-1] = max(end, time[-2])
        time = np.minimum(time, band.until)
        axes.fill_between(time, low, high, step="post", color=series(k), alpha=0.16, linewidth=0)
        style = ("-", (0, (5, 2)), (0, (1, 1.3)), (0, (6, 2, 1, 2)))[k % 4]  # also told apart in black and white
        axes.step(time, mean, where="post", color=series(k), linewidth=2.0, linestyle=style, label=_shown(label))
    axes.set_xlim(0.0, end)
    axes.set_ylim(0.0, 1.04 * max(float(band.high.max()) for band in bands.values()))
    axes.locator_params(axis="y", integer=True)
    _legend(figure)
    return save_figure(figure, path, formulas=False)


def share_bars(path: str | Path, shares: Mapping[str, Mapping[str, Share]], exits: Sequence[str]) -> Path:
    """Draw which share of the people took which exit, a bar for each label and exit, and return the path.

    Parameters
    ----------
    path : ends in .png.
    shares : label -> exit -> share in 0..1; exits that a label does not have are left out.
    exits : from top to bottom.

    Raises
    ------
    ValueError
        If the suffix is another, or there is no exit.
    """
    if not exits or not shares:
        raise ValueError("bars of shares need at least one exit and one label")
    thick = 0.8 / len(shares)
    figure = new_figure((_WIDTH, 0.9 + len(exits) * max(0.34, 0.2 * len(shares)) + 0.22 * len(shares)), dpi=_DPI)
    axes = quiet_axes(figure.add_subplot(), "share of those who got out [%]", "")
    for k, (label, of_exit) in enumerate(shares.items()):
        rows = [row for row, name in enumerate(exits) if name in of_exit]
        found = 100.0 * np.nan_to_num(np.array([of_exit[exits[row]] for row in rows]).reshape(-1, 3), nan=np.nan)
        at = np.array(rows) + (k - 0.5 * (len(shares) - 1)) * thick
        axes.barh(at, np.nan_to_num(found[:, 0]), 0.86 * thick, color=series(k), alpha=0.75, label=_shown(label))
        around = np.abs(np.nan_to_num(found[:, 1:] - found[:, :1]))
        axes.errorbar(found[:, 0], at, xerr=around.T, fmt="none", ecolor=hex_of(INK), elinewidth=1.1, capsize=2.5)
    axes.set_yticks(range(len(exits)), labels=exits)
    axes.set_ylim(len(exits) - 0.5, -0.5)
    axes.set_xlim(0.0, 100.0)
    _legend(figure)
    return save_figure(figure, path, formulas=False)


def _legend(figure: Any) -> None:
    """Name the labels below the axes, where no curve passes."""
    figure.legend(loc="outside lower left", frameon=False, fontsize=9.5, labelcolor=hex_of(INK), handlelength=2.6)
