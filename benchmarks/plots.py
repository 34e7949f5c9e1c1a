"""Plots of `scaling` and `roofline`, from the figures alone; matplotlib is loaded only when there is something to draw."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowd_env.rendering.canvas import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colors of Okabe and Ito that color-blind people tell apart, with markers that say the same again.
_STYLES = (("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#CC79A7", "D"), ("#000000", "v"))


def draw(result: dict[str, Any], folder: Path) -> Path | None:
    """Write CASE.png into the folder if the case has a plot; say where.

    Raises
    ------
    ModuleNotFoundError
        If matplotlib is not installed.
    """
    if result["case"] not in _PLOTS:
        return None
    figure = new_figure((7.2, 4.6), dpi=130)
    _PLOTS[result["case"]](result["rows"], figure)
    return save_figure(figure, folder / f"{result['case']}.png")


def _scaling(rows: list[dict[str, Any]], figure: "Figure") -> None:
    """Draw CPU time per person-step against people, with the exponents."""
    lines: dict[str, list[tuple[int, float]]] = {}
    exponents: dict[str, float] = {}
    for row in rows:
        who, _, quantity = row["what"].rpartition(": ")
        if quantity == "a person-step":
            name, _, count = who.rpartition(", ")
            lines.setdefault(name, []).append((int(count.split()[0]), row["value"]))
        elif quantity == "exponent":
            exponents[who] = row["value"]
    axes = figure.subplots()
    for (name, points), (color, marker) in zip(lines.items(), _STYLES, strict=False):
        label = f"{name}: exponent {exponents[name]:.2f}" if name in exponents else name
        axes.loglog(*zip(*points, strict=True), color=color, marker=marker, label=label)
    axes.set_xlabel("people in the jam (6 per m²)")
    axes.set_ylabel("CPU time of a person-step, ns")
    axes.set_title("Cost of a person-step against the size of the crowd", fontsize=11)
    axes.grid(True, which="major", color="0.88")
    axes.legend(title="scheme, time step", frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _roofline(rows: list[dict[str, Any]], figure: "Figure") -> None:
    """Draw arithmetic against its intensity: slopes of bandwidth, the flat roof, and where dem is."""
    value = {row["what"]: row["value"] for row in rows if row["ratio"] is None}
    roof = value["arithmetic, multiply-add"]
    axes = figure.subplots()
    low, high, lowest = 0.05, 20.0, float("inf")
    for name in ("L1", "L2", "L3", "DRAM"):
        speed = value[f"bandwidth in {name}"]
        knee = min(roof / speed, high)
        axes.plot([low, knee], [low * speed, knee * speed], color="0.45", linewidth=1)
        lowest = min(low * speed, lowest / 1.2)  # so that words do not lie on each other
        axes.annotate(
            f"{name} {speed:.0f} GB/s",
            (low, lowest),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            fontsize=8,
        )
    axes.plot([low, high], [roof, roof], color="0.2")
    axes.annotate(
        f"multiply-add {roof:.0f} GF/s", (high, roof), xytext=(0, 4), textcoords="offset points", ha="right", fontsize=8
    )
    names = [what.removesuffix(": intensity") for what in value if what.endswith(": intensity")]
    for name, (color, marker) in zip(names, _STYLES, strict=False):
        x, y = value[f"{name}: intensity"], value[f"{name}: arithmetic"]
        axes.plot(x, y, color=color, marker=marker, linestyle="none", markersize=8, label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(low / 2.6, high)
    axes.set_xlabel("floating-point operations per byte that must be moved")
    axes.set_ylabel("10⁹ floating-point operations per CPU second")
    axes.set_title("dem, step of 0.001 s, against what one core can do", fontsize=11)
    axes.grid(True, which="major", color="0.9")
    axes.legend(frameon=False, loc="lower right", fontsize=9)


_PLOTS: dict[str, Callable[[list[dict[str, Any]], "Figure"], None]] = {"scaling": _scaling, "roofline": _roofline}
