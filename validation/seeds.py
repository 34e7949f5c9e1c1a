"""What runs of the main job with several seeds learned, from full speed: a table, and one picture of their curves.

``python -m validation.seeds FOLDER`` draws FOLDER/learning.png.
"""

import sys
from pathlib import Path

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Plain
from validation.pages import Rows
from validation.sources import Source

_BESIDE = ("follow", "evolution")


def seeds(source: Source) -> Rows:
    """One row a run, which lies in FOLDER/SEED."""
    return [_row(source, run) for run in _runs(source)]


def draw(folder: Path) -> None:
    """Draw the curves of all runs in a folder."""
    source = Source(lambda _: {}, folder)
    runs = _runs(source)
    rules = {row["policy"]: row["clearing_time"]["mean"] for row in source.read(f"{runs[0]}/results.json")["rows"]}
    _draw([_curve(source, run) for run in runs], {name: rules[name] for name in _BESIDE}, folder / "learning.png")


def _runs(source: Source) -> list[str]:
    return sorted((one.parent.name for one in source.folder.glob("*/results.json")), key=int)


def _row(source: Source, run: str) -> Plain:
    told = source.read(f"{run}/results.json")
    rows = {row["policy"]: row for row in told["rows"]}
    learned, beside = rows["learned"], rows["evolution"]["clearing_time"]["mean"]
    kept = f"of step {told['confirmation']['steps']:,.0f}" if told["confirmation"]["kept"] == "trained" else "the start"
    return {
        **told,
        **learned,
        "seed": run,
        "kept": kept,
        "time": learned["clearing_time"],
        "ratio": learned["clearing_time"]["mean"] / beside,
    }


def _curve(source: Source, run: str) -> Floats:
    """Return CPU seconds and times of the last person [s] of what a run had by then (T, 2)."""
    from crowd_env.agents.learned.curve import CURVE, read_curve

    rows = read_curve(source.folder / run / CURVE)
    return np.array([(row["cpu_seconds"], row["evacuation_time"]) for row in rows])


def _draw(curves: list[Floats], reference: dict[str, float], path: Path) -> None:
    from crowd_env.rendering import learning_curve, save_figure

    at = np.linspace(0.0, min(curve[-1, 0] for curve in curves), 400)
    figure = learning_curve(
        at,
        {f"{len(curves)} seeds": np.array([np.interp(at, *curve.T) for curve in curves])},
        reference=reference,
        title="Learning from full speed: mean and range",
        xlabel="CPU seconds",
    )
    save_figure(figure, path)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
