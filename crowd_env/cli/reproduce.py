"""The command ``crowd-env reproduce``."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from crowd_env.cli.console import wide_console
from crowd_env.cli.options import AsJson, new_app, plain, section
from crowd_env.core.checks import Plain
from crowd_env.core.console import check_folder, friendly_errors, interrupted, progress_bar, say
from crowd_env.core.executors import Executor, Processes, RayCluster, Serial, all_cores
from crowd_env.core.files.store import Store
from crowd_env.rendering.canvas import save_figure
from crowd_env.reproduce import FIGURES, PAPERS, Case, Figure, Result, Settings, find
from crowd_env.reproduce.evacuations import Interrupted, evacuate
from crowd_env.reproduce.paper import flag

app = new_app()

_NAMES = f"{', '.join(FIGURES)}; those of one paper: {', '.join(PAPERS)}; of every paper: all; what they are: list."
_RUNS = "Number of draws; default 3 (hostikka), 10 (lin), 20 (helbing), 40 (moussaid), 50 (pecol), 100 (the theatre)."
_CHANGES = "Change a setting of the paper; list says which there are."
_OUT = "Folder for the CSV files, the figure and, in its folder runs, the runs that are kept."
_RAY = "Spread the draws over a Ray cluster, see docs/ray.md. Results do not depend on it."
_FRESH = "Compute all runs again instead of taking those kept."
of_kept = section("Evacuations, which are kept and shared by figures")


@app.command()
def reproduce(
    name: Annotated[str, typer.Argument(metavar="NAME", help=_NAMES)],
    runs: Annotated[int | None, plain(_RUNS)] = None,
    seed: Annotated[int | None, plain("Draw k has the seed SEED + k; default 0.")] = None,
    set_: Annotated[list[str] | None, plain(_CHANGES, names=("--set",), metavar="NAME=VALUE")] = None,
    as_json: AsJson = False,
    out: Annotated[Path, plain(_OUT)] = Path("reproduce"),
    workers: Annotated[int | None, of_kept("Processes; default one a core. Results do not depend on it.")] = None,
    fresh: Annotated[bool, of_kept(_FRESH, names=("--fresh",))] = False,
    ray: Annotated[bool, plain(_RAY, names=("--ray",))] = False,
) -> None:
    """Redo a table or figure, of a paper, a footbridge or grains, and print both numbers.

    Writes NAME.csv, the numbers behind it and NAME.png into the folder --out.

    Evacuations are kept in the folder runs inside it, also after an interruption.

    Examples: crowd-env reproduce table3

    crowd-env reproduce table5 --runs 50 --set door_width=0.9

    crowd-env reproduce lin-fig7 --set preset=literal --runs 5
    """
    if name == "list":
        show_names(as_json)
        return
    options = {"runs": runs, "seed": seed, "workers": workers, "fresh": fresh, "ray": ray}
    results: list[Result] = []
    stopped: str | None = None
    with friendly_errors():
        given = {key: value for key, value in options.items() if value is not None and value is not False}
        given |= dict(_setting(text) for text in set_ or ())
        chosen = _select(name, given, out)
        store = Store(out / "runs")
        with closing(_executor(given)) as executor, store.alone():
            try:
                for result in _results(chosen, store, executor, fresh):
                    paths = _write(result, out)
                    results.append(result)
                    if not as_json:
                        show(result)
                    say(f"files: {', '.join(str(path) for path in paths)}")
            except Interrupted as error:
                stopped = str(error)
            except KeyboardInterrupt:
                stopped = f"{chosen[len(results)].name} is not finished"
    if as_json and (results or stopped is None):
        typer.echo(json.dumps(as_object(name, results), allow_nan=False))
    if stopped is not None:
        done = ", ".join(result.name for result in results)
        interrupted(stopped + (f"; whole: {done}" if done else ""))


def _setting(text: str) -> tuple[str, Any]:
    """Return the name and the value of NAME=VALUE.

    Raises
    ------
    ValueError
        If no paper has such a setting, or its value is of another kind.
    """
    name, equals, value = text.partition("=")
    known = {one.name: paper.settings for paper in PAPERS.values() for one in fields(paper.settings)}
    if not equals or name not in known:
        raise ValueError(f"--set {text}: name a setting and its value, NAME=VALUE; known: {', '.join(known)}")
    return name, known[name].read(name, value)


class _Chosen(NamedTuple):
    """A figure that is to be done, all of it checked."""

    name: str
    figure: Figure[Any]
    settings: Settings
    cases: Mapping[Any, Case]


def _results(chosen: list[_Chosen], store: Store, executor: Executor, fresh: bool) -> Iterator[Result]:
    """Yield one result after the other; runs that a figure shares with one before are taken from the store."""
    made: set[str] = set()
    for name, figure, settings, cases in chosen:
        with progress_bar(name, sum(len(case.seeds) for case in cases.values())) as progress:
            old = {key: case for key, case in cases.items() if not fresh or case.name(0) in made}
            new = {key: case for key, case in cases.items() if key not in old}
            runs = evacuate(new, store, executor, fresh=fresh, progress=progress)
            runs |= evacuate(old, store, executor, progress=progress)
        made |= {case.name(0) for case in cases.values()}
        yield figure.redo(name, settings, {key: runs[key] for key in cases})


def _executor(given: Plain) -> Executor:
    """Return what computes; a cluster is connected to."""
    if "ray" in given:
        return RayCluster()
    workers = given.get("workers", all_cores())
    return Serial() if workers == 1 else Processes(workers)


def _select(name: str, given: Plain, out: Path) -> list[_Chosen]:
    """Return what is to be done; an option goes to all the chosen figures that take it.

    Raises
    ------
    ValueError
        In one sentence, if a name or an option is wrong, belongs to nothing that is chosen, or cannot be used.
    """
    names = [(key, one) for key, figures in find(name).items() for one in figures]
    for option in given:
        if not any(FIGURES[one].takes(option) for _, one in names):
            takers = ", ".join(one for one, figure in FIGURES.items() if figure.takes(option))
            raise ValueError(f"{flag(option)} belongs to {takers}; {name} has no use for it")
    if given.get("workers", 1) < 1:
        raise ValueError(f"--workers is {given['workers']}; it must be at least 1")
    if "workers" in given and "ray" in given:
        raise ValueError(
            f"--workers is {given['workers']} beside --ray: processes of this machine, or a cluster; leave one out"
        )
    parts = []
    for key, name in names:
        settings, what = PAPERS[key].settings_of(name, given), FIGURES[name]
        cases = {} if what.cases is None else what.cases(settings)
        for case in cases.values():
            case.check()
        if cases:
            next(iter(cases.values())).place.field()  # is a plan too large for a map of ways?
        parts.append(_Chosen(name, what, settings, cases))
    check_folder("--out", out)
    return parts


def _write(result: Result, out: Path) -> list[Path]:
    """Write the CSV files and, if it can be drawn, the figure."""
    try:
        paths = result.save(out)
        try:
            paths.append(save_figure(result.draw(), out / f"{result.name}.png"))
            if result.film is not None:
                paths.append(result.film(out / f"{result.name}.gif"))
        except ModuleNotFoundError as error:
            say(f"no figure: {error}", "yellow")
    except OSError as error:
        raise ValueError(f"cannot write the results: {error}") from None
    return paths


def show(result: Result) -> None:
    """Print a result as a table, followed by its remarks."""
    console = wide_console()
    table = Table(title=result.title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("quantity", max_width=34)
    for head in ("paper", "here", "difference"):
        table.add_column(head, justify="right")
    table.add_column("n", justify="right")
    table.add_column("estimator and reading used", ratio=1)
    for rows in result.sections:
        for row in rows:
            quantity = row.quantity if row.unit in ("1", "share", result.unit) else f"{row.quantity} [{row.unit}]"
            cells = (quantity, row.paper or "-", row.shown(), row.difference(), str(row.n), row.explained())
            table.add_row(*cells)
        table.add_section()
    console.print(table)
    if result.options:
        changed = ", ".join(f"{key} {value}" for key, value in result.options.items())
        console.print(f"Settings that differ from the defaults: {changed}")
    for remark in result.remarks:
        console.print(f"* {remark}")
    console.print()


def as_object(name: str, results: Sequence[Result]) -> Plain:
    """Return what ``--json`` prints: a result, or those of a group put together."""
    if name in FIGURES:
        return results[0].as_json()
    parts = [result.as_json() for result in results]
    rows = [{"of": part["name"], **row} for part in parts for row in part["rows"]]
    remarks = [f"{part['name']}: {remark}" for part in parts for remark in part["remarks"]]
    options = {key: value for part in parts for key, value in part["options"].items()}
    return {"name": name, "rows": rows, "remarks": remarks, "options": options}


def show_names(as_json: bool) -> None:
    """Print what can be redone."""
    if as_json:
        titles = {name: figure.title for name, figure in FIGURES.items()}
        groups = {**{name: list(paper.figures) for name, paper in PAPERS.items()}, "all": list(FIGURES)}
        times = {name: _duration(figure.cpu_time) for name, figure in FIGURES.items()}
        typer.echo(json.dumps({"names": titles, "groups": groups, "cpu_time": times}))
        return
    table = Table("name", "table or figure", "about", box=SIMPLE_HEAD, pad_edge=False)
    for paper in PAPERS.values():
        for name, figure in paper.figures.items():
            table.add_row(name, figure.title, _duration(figure.cpu_time), end_section=name == list(paper.figures)[-1])
    for name, paper in PAPERS.items():
        table.add_row(name, f"all of {paper.title}", _duration(paper.cpu_time))
    table.add_row("all", "all papers", _duration(sum(paper.cpu_time for paper in PAPERS.values())))
    console = wide_console()
    console.print(table)
    for paper in PAPERS.values():
        settings = Table(f"--set, {paper.title}", "default", "meaning", box=SIMPLE_HEAD, pad_edge=False)
        for one in fields(paper.settings):
            if one.name not in ("runs", "seed"):
                settings.add_row(one.name, "" if one.default is None else str(one.default), one.metadata["help"])
        console.print(settings)
    console.print("about: time on one core with the default draws; evacuations spread over the cores and are kept.")


def _duration(seconds: float) -> str:
    return f"{seconds:g} s" if seconds < 60 else f"{seconds / 60:g} min"
