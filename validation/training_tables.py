"""The table of docs/training.md: what the main job has learned, beside the rules."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.pages import Sources

TRAINING_HEAD = (
    "policy",
    "exits blocked (Wilson interval)",
    "last person out, of the runs that ended, s",
    "mean exit time, s",
    "flow, 1/s",
    "contact impulse, N s per person",
    "worst pressure, kN/m",
    "above 1600 N/m",
)


def training(source: "Sources") -> list[list[str]]:
    """One row a policy."""
    rows = []
    for row in source.read("results.json")["rows"]:
        low, high = row["blocked_share"]["ci95"]
        crushed = f"{100.0 * row['crushed_share']['mean']:.0f} %"
        if row["crushed_time"]["mean"] is not None:
            crushed += f", for {row['crushed_time']['mean']:.1f} s"
        rows.append(
            [
                f"`{row['policy']}`",
                f"{row['blocked']} of {row['runs']} ({100.0 * low:.0f} to {100.0 * high:.0f} %)",
                _with_interval(row["clearing_time"]),
                _with_interval(row["mean_exit"]),
                f"{row['flow']:.2f}",
                f"{row['contact_impulse']['mean']:.0f}",
                f"{row['max_pressure']['mean'] / 1e3:.1f}",
                crushed,
            ]
        )
    return rows


def training_note(source: "Sources") -> str:
    """Say what was trained, and which of its networks was kept."""
    from crowd_env.agents.learned.training import read_curve  # brings torch

    found = source.read("results.json")
    config, rows = found["config"], {row["policy"]: row for row in found["rows"]}
    curve = read_curve(source.path("learning_curve.csv"))
    first, last = curve[0], curve[-1]
    best = next(row for row in curve if row["steps"] == found["validation"]["steps"])
    learned = rows["learned"]["clearing_time"]["mean"]
    sooner = ", ".join(
        f"{100.0 * (1.0 - learned / rows[name]['clearing_time']['mean']):.0f} % sooner than `{name}`"
        for name in ("rule-best-speed", "density-cap", "follow", "zipper")
    )
    return (
        f"{rows['learned']['runs']} held-out draws of `{config['task']}` under `{config['scheme']}`, "
        f"{rows['learned']['people']} people; trained with {config['people']}, seed {config['seed']}, "
        f"{last['steps'] / 1e6:.1f} million steps, {last['cpu_seconds']:.0f} s of processor time. The last of the learned "
        f"crowd is out {sooner}. Of the {len(curve)} networks that were evaluated on {config['eval_runs']} validation draws "
        f"each, the one after {100.0 * best['steps'] / last['steps']:.0f} % of the training is kept "
        f"({best['evacuation_time']:.1f} ± {best['standard_error']:.1f} s, standard error); the clone that it began with takes "
        f"{first['evacuation_time']:.1f} s and touches with {first['contact_impulse']:.0f} N s per person, the kept one with "
        f"{best['contact_impulse']:.0f} N s; the last network takes {last['evacuation_time']:.1f} s. Means of the worst "
        "pressure are over runs; above 1600 N/m, the threshold of an injury of Helbing, Farkas, Vicsek (2000), is the share of "
        "people who once bore more, and for how long these did in all."
    )


def _with_interval(found: dict[str, Any]) -> str:
    """Return a mean with its interval."""
    if found["mean"] is None:
        return "–"
    low, high = found["ci95"]
    return f"{found['mean']:.1f}" + ("" if low is None else f" [{low:.1f}, {high:.1f}]")
