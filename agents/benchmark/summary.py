"""What a benchmark comes to: a row for each algorithm over its seeds, a table, and figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.json_file import json_number
from crowd_env.envs.metrics import share_interval

from .statistics import bootstrap_interval, interquartile_mean, performance_profile

Results = Mapping[str, Sequence[Mapping[str, Any]]]  # name -> its finished results, one a seed


def clearing_of(result: Mapping[str, Any]) -> Floats:
    """Return the clearing times (R,) [s] of the held-out runs, nan where somebody was left inside."""
    return np.array([np.nan if one is None else one for one in result["of_runs"]["clearing_times"]])


def score(result: Mapping[str, Any]) -> float:
    """Return the mean clearing time [s] of a result; infinite if any run was left unfinished."""
    times = clearing_of(result)
    return float(times.mean()) if np.isfinite(times).all() else np.inf


def summarize(results: Results) -> dict[str, Any]:
    """Return a row for each algorithm or policy, ready for JSON.

    ``clearing_time`` is the interquartile mean over seeds of the mean clearing time on held-out draws, of runs that cleared,
    with its bootstrap interval over seeds; of a policy without seeds the mean over draws, with its interval over draws.
    ``unfinished`` counts runs of all seeds, with Wilson's interval of their share.
    """
    rows = {}
    for name, found in results.items():
        times = [clearing_of(result) for result in found]
        of_seed = np.array([np.nanmean(one) if np.isfinite(one).any() else np.nan for one in times])
        known = of_seed[np.isfinite(of_seed)]
        unfinished, runs = sum(int(np.isnan(one).sum()) for one in times), sum(map(len, times))
        seeds = "seed" in found[0]
        middle = float(interquartile_mean(known)) if len(known) else np.nan
        low, high = bootstrap_interval(known) if seeds else found[0]["final"]["clearing_time"]["ci95"]
        curves = [result["curve"][-1] for result in found if "curve" in result]
        rows[name] = {
            "seeds": len(found) if seeds else 0,
            "clearing_time": {"iqm": json_number(middle), "ci95": [_number(low), _number(high)]},
            "of_seeds": [json_number(value) for value in of_seed],
            "unfinished": {"runs": unfinished, "of": runs, "ci95": list(share_interval(unfinished, runs))},
            "mean_exit": float(np.mean([result["final"]["mean_exit"]["mean"] for result in found])),
            "flow": json_number(np.mean([result["final"]["flow"] or np.nan for result in found])),
            "steps": int(np.mean([row["steps"] for row in curves])) if curves else None,
            "seconds": float(np.mean([row["seconds"] for row in curves])) if curves else None,
        }
    return rows


def _number(value: float | None) -> float | None:
    return None if value is None else json_number(value)


def table(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown, the soonest first."""
    lines = [
        "| policy | seeds | unfinished runs | clearing time, s | mean exit, s | flow, 1/s | decisions, 10⁶ | training, CPU s |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, row in sorted(rows.items(), key=lambda item: (item[1]["unfinished"]["runs"] > 0, _middle(item[1]))):
        time, left = row["clearing_time"], row["unfinished"]
        low, high = time["ci95"]
        between = "" if low is None or high is None else f" [{low:.1f}, {high:.1f}]"
        share = f" ({100 * left['ci95'][0]:.0f} to {100 * left['ci95'][1]:.0f} %)"
        cells = [
            f"`{name}`",
            str(row["seeds"] or "–"),
            f"{left['runs']} of {left['of']}{share}",
            "–" if time["iqm"] is None else f"{time['iqm']:.1f}{between}",
            f"{row['mean_exit']:.1f}",
            "–" if row["flow"] is None else f"{row['flow']:.2f}",
            "–" if row["steps"] is None else f"{row['steps'] / 1e6:.2f}",
            "–" if row["seconds"] is None else f"{row['seconds']:.0f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _middle(row: Mapping[str, Any]) -> float:
    found = row["clearing_time"]["iqm"]
    return np.inf if found is None else float(found)


def draw(folder: Path, results: Results, task: str, people: int) -> list[Path]:
    """Draw learning curves over decisions and over processor time, and performance profiles; return the files.

    Curves are of validation draws of the place that is trained in, interquartile means over seeds with 95 % intervals;
    profiles are of held-out draws of the task with so many ``people``.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, save_figure
    from crowd_env.rendering.palette import QUIET, SERIES

    learned = {name: found for name, found in results.items() if "curve" in found[0]}
    files = []
    if learned:
        trained = next(iter(learned.values()))[0]["config"]["people"]
        title = f"{task}: validation draws with the {trained} people of training"
        figure = new_figure((11.0, 6.5))
        panels = figure.subplots(2, 2, sharex="col")
        for column, (unit, label, scale) in enumerate(
            [("steps", "decisions of people, millions", 1e-6), ("seconds", "processor time, s", 1.0)]
        ):
            upper, lower = panels[:, column]
            quiet_axes(upper, "", "clearing time of runs that cleared, s", title="" if column else title, grid=True)
            quiet_axes(lower, label, "share of runs unfinished", grid=True)
            # Times differ by factors, and so does what an algorithm makes of its budget.
            upper.set_yscale("log")
            upper.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
            upper.yaxis.set_major_formatter("{x:g}")
            upper.yaxis.set_minor_formatter(NullFormatter())
            if unit == "steps":
                lower.set_xscale("symlog", linthresh=0.5)
                lower.xaxis.set_major_formatter("{x:g}")
            for k, (name, found) in enumerate(learned.items()):
                color, line = hex_of(SERIES[k % len(SERIES)]), _line(k, len(SERIES))
                at = scale * np.mean([[row[unit] for row in one["curve"]] for one in found], axis=0)
                for axes, values in ((upper, _column(found, "clearing_time")), (lower, _unfinished(found))):
                    middle, low, high = _over_seeds(values)
                    axes.fill_between(at, low, high, color=color, alpha=0.18, linewidth=0)
                    axes.plot(at, middle, line, color=color, linewidth=1.8, label=f"{name} ({len(found)})")
        panels[0, 1].legend(frameon=False, fontsize=8, title="algorithm (seeds)", title_fontsize=8)
        files.append(save_figure(figure, folder / "curves.png"))
    figure = new_figure((7.0, 4.2))
    axes = quiet_axes(
        figure.subplots(),
        "clearing time, s",
        "share of held-out runs cleared by then",
        title=f"{task}: {people} people",
        grid=True,
    )
    known = np.concatenate([clearing_of(one) for found in results.values() for one in found])
    known = known[np.isfinite(known)]
    at = np.linspace(known.min() - 2.0, min(known.max(), 3.0 * known.min()), 200)
    for k, (name, found) in enumerate(results.items()):
        profile = performance_profile(np.concatenate([clearing_of(one) for one in found]), at)
        style: dict[str, Any] = {
            "color": hex_of(SERIES[k % len(SERIES)]),
            "linestyle": _line(k, len(SERIES)),
            "linewidth": 1.8,
        }
        if name not in learned:
            style = {"color": hex_of(QUIET), "linewidth": 1.2, "linestyle": ("-", "--", ":", "-.")[k % 4]}
        axes.plot(at, profile, label=name, **style)
    axes.legend(frameon=False, fontsize=8)
    files.append(save_figure(figure, folder / "profiles.png"))
    return files


def _line(k: int, colors: int) -> str:
    """Return the style of the line of the k-th algorithm: dashed when the colors begin again."""
    return "-" if k < colors else "--"


def _column(found: Sequence[Mapping[str, Any]], name: str) -> Floats:
    """Return a figure of all checkpoints (seeds, checkpoints), nan where there is none."""
    return np.array(
        [[np.nan if row[name] is None else row[name] for row in one["curve"]] for one in found], dtype=float
    )


def _unfinished(found: Sequence[Mapping[str, Any]]) -> Floats:
    return np.array([[row["unfinished"] / one["validation_runs"] for row in one["curve"]] for one in found])


def _over_seeds(values: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the interquartile mean over seeds and its bootstrap interval, at every checkpoint; nan are left out."""
    columns = [column[np.isfinite(column)] for column in values.T]
    middle = np.array([interquartile_mean(column) if len(column) else np.nan for column in columns])
    bounds = np.array([bootstrap_interval(column, resamples=2000) for column in columns])
    return middle, bounds[:, 0], bounds[:, 1]
