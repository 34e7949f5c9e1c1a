"""Compare ways to lead people out, under every contact scheme, on the same draws: ``python -m agents.evaluate``."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.evaluation.comparison import last_times, mean_times, minus_first, ranking
from agents.evaluation.entries import Entry, make_entries
from agents.evaluation.evaluation import HELD_OUT_SEED, Evaluation, evaluate_driver
from agents.evaluation.folder import EvaluationFolder, settings_of
from agents.evaluation.report import crowding_table, exits_table, left_table, ranking_lines, table_console, times_table
from agents.runs import versions
from agents.stopping import stops_by
from agents.training_config import check_runs
from crowd_env import SCHEMES, CrowdEnv, Scenario, make_scenario, make_scheme
from crowd_env.console import notes, progress_bar
from crowd_env.files.json_file import write_json

_EXAMPLE = """examples:
  python -m agents.evaluate --scenario two-exit-hall-v0 --policies shortest fastest --schemes dem nsm2 --runs 20
  python -m agents.evaluate --scenario my_hall.toml --policies rules north runs/x/best.npz --out comparison
"""


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m agents.evaluate",
        description="Compare ways to lead people out, under every contact scheme, on the same draws.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scenario", default="room-v0", help="name of a scenario, or a scenario file (%(default)s)")
    parser.add_argument(
        "--policies",
        nargs="+",
        default=["shortest", "fastest"],
        metavar="POLICY",
        help="shortest, nearest, fastest, comfortable; the name of a route or exit; rules: the shortest path with the "
        "scenario's control rules in force, which are off for all others; random, stand-still; or a learned network (.npz)."
        "  The others are compared with the first.",
    )
    parser.add_argument("--schemes", nargs="+", default=["nsm2"], metavar="SCHEME", help=f"{', '.join(SCHEMES)} (nsm2)")
    parser.add_argument("--runs", type=int, default=100, help="evacuations of each policy and scheme (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="other draws; all are held out from training (%(default)s)")
    parser.add_argument("--threads", type=int, default=1, help="of the simulation; results do not depend on it")
    parser.add_argument("--out", type=Path, help="folder for tables, curves and maps; an interrupted one goes on there")
    parser.add_argument(
        "--trust-pickle",
        action="store_true",
        help="open networks of stable-baselines3 (.zip) too: opening one runs whatever code its maker put in",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    return parser


def compare(
    entries: Sequence[Entry],
    scenario: Scenario,
    schemes: Sequence[str],
    *,
    runs: int,
    seed: int = 0,
    threads: int = 1,
    folder: EvaluationFolder | None = None,
) -> list[Evaluation]:
    """Evaluate every entry under every scheme: run ``k`` of all of them starts from the same people in the same places.

    What ``folder`` has kept is taken from there.
    """
    results: list[Evaluation] = []
    total = len(schemes) * len(entries)
    for scheme in schemes:
        warm = False
        for entry in entries:
            result = folder.load(entry, scheme) if folder is not None else None
            if result is None:
                if not warm:
                    _warm_up(scheme)
                    warm = True
                result = _evaluate(entry, scenario, scheme, runs, seed, threads, f"{len(results) + 1}/{total}")
                if folder is not None:
                    folder.save(entry, scheme, result)
            results.append(result)
    return results


def _evaluate(
    entry: Entry, scenario: Scenario, scheme: str, runs: int, seed: int, threads: int, number: str
) -> Evaluation:
    title = f"{number} {entry.name}, {scheme}"
    with progress_bar(title, runs) as progress:
        result = evaluate_driver(
            entry.driver(scenario, scheme, threads),
            scenario,
            entry.name,
            scheme,
            runs=runs,
            first_seed=HELD_OUT_SEED + seed,
            measure=True,
            progress=progress,
        )
    if not notes.is_terminal:  # no bar there: say the same in lines
        notes.print(f"{title}: mean exit time {mean_times(result).mean():.2f} s", markup=False)
    return result


def _warm_up(scheme: str) -> None:
    """Load the kernels, so that compiling them is not counted as computing."""
    env = CrowdEnv("room-v0", scheme=scheme, strategy="fastest")
    env.reset(seed=0)
    env.step(None)


def summary(results: Sequence[Evaluation], scenario: Scenario, settings: dict[str, Any]) -> dict[str, Any]:
    """Return everything about an evaluation but single runs, ready for JSON."""
    rows = []
    for result in results:
        first = next(one for one in results if one.scheme == result.scheme)
        all_counted = {"last": float(last_times(result).mean()), "mean": float(mean_times(result).mean())}
        rows.append(result.row() | {"unfinished_at_limit": all_counted, "minus_first": minus_first(result, first)})
    return {
        **settings,
        "people": scenario.population.count,
        "time_limit": scenario.time_limit,
        "rows": rows,
        "ranking": {"last": ranking(results), "mean": ranking(results, of=mean_times)},
        "versions": versions(),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    asked = _arguments().parse_args(arguments)
    try:
        with stops_by():
            results, scenario, told = _run(asked)
    except (ValueError, FloatingPointError, ModuleNotFoundError, OSError, MemoryError) as error:
        notes.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        return 2
    except KeyboardInterrupt:
        again = "; the same command goes on" if asked.out is not None else ""
        notes.print(f"stopped{again}", markup=False)
        return 130
    if asked.json:
        print(json.dumps(told, allow_nan=False))
        return 0
    console = table_console()
    title = f"{scenario.name}: {scenario.population.count} people, {asked.runs} runs each"
    for table in (times_table(results, title), left_table(results), exits_table(results), crowding_table(results)):
        if table is not None:
            console.print(table)
    for line in ranking_lines(results):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    return 0


def _run(asked: argparse.Namespace) -> tuple[list[Evaluation], Scenario, dict[str, Any]]:
    scenario = make_scenario(asked.scenario)
    check_runs(asked.runs)
    if not 0 <= asked.seed < HELD_OUT_SEED - asked.runs:
        raise ValueError(f"--seed is {asked.seed}; it must be from 0 to {HELD_OUT_SEED - asked.runs - 1}")
    if asked.threads < 1:
        raise ValueError(f"--threads is {asked.threads}; it must be at least 1")
    schemes = list(dict.fromkeys(asked.schemes))
    for scheme in schemes:
        make_scheme(scheme)
    entries = make_entries(asked.policies, scenario, trust_pickle=asked.trust_pickle)
    if "rules" in asked.policies and not scenario.rules:
        notes.print(f"note: {scenario.name} has no control rules; rules is shortest there", markup=False)
    settings = settings_of(scenario, asked.runs, asked.seed)
    folder = None
    if asked.out is not None:
        from crowd_env.rendering.canvas import new_figure

        new_figure((1.0, 1.0))  # says now, not after the work, that the drawing library is missing
        folder = EvaluationFolder(asked.out, settings)
    results = compare(
        entries, scenario, schemes, runs=asked.runs, seed=asked.seed, threads=asked.threads, folder=folder
    )
    told = summary(results, scenario, settings)
    if folder is not None:
        write_json(folder.path / "rows.json", told)
        folder.write_runs(results, HELD_OUT_SEED + asked.seed)
        made = folder.draw(results, scenario)
        notes.print(f"rows.json, runs.csv and {len(made)} pictures: {folder.path}/", markup=False, soft_wrap=True)
    return results, scenario, told


if __name__ == "__main__":
    sys.exit(main())
