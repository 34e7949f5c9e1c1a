"""The command ``crowd-env reproduce``."""

import json
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from crowd_env.cli.console import AsJson
from crowd_env.core.console import check_folder, friendly_errors, interrupted, notes, progress_bar
from crowd_env.core.executors import Executor, all_cores, make_executor
from crowd_env.core.files.store import Store
from crowd_env.rendering.canvas import save_figure
from crowd_env.reproduce import FIGURES, PAPERS, Case, Figure, Result, Settings, find
from crowd_env.reproduce.evacuations import Interrupted, evacuate
from crowd_env.reproduce.paper import flag
from crowd_env.reproduce.report import as_object, show, show_names

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

# What were options of their own.
SETTINGS = {
    f"--{one.name.replace('_', '-')}": f"--set {one.name}=VALUE"
    for paper in PAPERS.values()
    for one in fields(paper.settings)
} | {"--n": "--set people=N"}

_KEPT = "Evacuations, which are kept and shared by figures"


@app.command()
def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help=f"{', '.join(FIGURES)}; those of one paper: {', '.join(PAPERS)}; of every paper: all; what they are: list.",
        ),
    ],
    runs: Annotated[
        int | None, typer.Option(help="Number of draws; default 10 (lin), 50 (pecol), 100 (the theatre).")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Draw k has the seed SEED + k; default 0.")] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Change a setting of the paper; list says which there are."),
    ] = None,
    as_json: AsJson = False,
    out: Annotated[
        Path, typer.Option(help="Folder for the CSV files, the figure and, in its folder runs, the runs that are kept.")
    ] = Path("reproduce"),
    workers: Annotated[
        int | None,
        typer.Option(help="Processes; default one a core. Results do not depend on it.", rich_help_panel=_KEPT),
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help="Compute all runs again instead of taking those kept.", rich_help_panel=_KEPT),
    ] = False,
    ray: Annotated[
        bool,
        typer.Option(
            "--ray", help="Spread the draws over a Ray cluster, see docs/ray.md. Results do not depend on it."
        ),
    ] = False,
) -> None:
    """Redo a table or figure of a paper, Pécol et al. 2011 or Lin, Ma, Lo, and print its numbers beside ours.

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
                    notes.print(f"files: {', '.join(str(path) for path in paths)}", markup=False, soft_wrap=True)
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
        yield figure.reproduce(settings, {key: runs[key] for key in cases})


def _executor(given: Mapping[str, Any]) -> Executor:
    """Return what computes; a cluster is connected to."""
    if "ray" in given:
        return make_executor("ray")
    workers = given.get("workers", all_cores())
    return make_executor("serial") if workers == 1 else make_executor("processes", workers=workers)


def _select(name: str, given: Mapping[str, Any], out: Path) -> list[_Chosen]:
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
        except ModuleNotFoundError as error:
            notes.print(f"no figure: {error}", style="yellow", markup=False, soft_wrap=True)
    except OSError as error:
        raise ValueError(f"cannot write the results: {error}") from None
    return paths
