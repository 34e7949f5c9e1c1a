"""The command ``crowd-env reproduce``."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.cli.console import AsJson
from crowd_env.cli.paper_options import takes_settings
from crowd_env.core.checks import counted
from crowd_env.core.console import check_folder, friendly_errors, interrupted, notes, progress_bar
from crowd_env.core.executors import Executor, all_cores, make_executor
from crowd_env.core.files.csv_table import write_csv
from crowd_env.rendering.canvas import save_figure
from crowd_env.reproduce import FIGURES, PAPERS, Figure, Paper, Result, Settings, Work, find
from crowd_env.reproduce.pool import Interrupted, complete, distinct
from crowd_env.reproduce.report import as_object, show, show_names
from crowd_env.reproduce.result import Halfway
from crowd_env.reproduce.settings import flag
from crowd_env.reproduce.store import Store

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

_KEPT = "Runs that are kept and shared by figures"


@app.command()
@takes_settings(PAPERS)
def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help=f"{', '.join(FIGURES)}; those of one paper: {', '.join(PAPERS)}; of every paper: all; what they are: list.",
        ),
    ],
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
    **options: Any,
) -> None:
    """Redo a table or figure of a paper, Pécol et al. 2011 or Lin, Ma, Lo, and print its numbers beside ours.

    Writes NAME.csv, the numbers behind it and NAME.png into the folder --out.

    Runs that figures share (lin-*) are kept in the folder runs inside it, also after an interruption.

    Examples: crowd-env reproduce table3

    crowd-env reproduce table5 --runs 50 --door-width 0.9

    crowd-env reproduce lin-fig7 --preset literal --runs 5
    """
    if name == "list":
        show_names(as_json)
        return
    options |= {"workers": workers, "fresh": fresh, "ray": ray}
    with friendly_errors():
        given = {key: value for key, value in options.items() if value is not None and value is not False}
        selection = _select(name, given, out)
    results: list[Result] = []
    stopped: str | None = None
    with friendly_errors(), closing(selection.executor()) as executor:
        try:
            for result in selection.results(executor):
                paths = _write(result, out)
                results.append(result)
                if not as_json:
                    show(result)
                notes.print(f"files: {', '.join(str(path) for path in paths)}", markup=False, soft_wrap=True)
        except Interrupted as error:
            stopped = str(error)
        except KeyboardInterrupt as error:
            stopped = _kept(selection.names[len(results)], error, out)
    if as_json and (results or stopped is None):
        typer.echo(json.dumps(as_object(name, results), allow_nan=False))
    if stopped is not None:
        done = ", ".join(result.name for result in results)
        interrupted(stopped + (f"; whole: {done}" if done else ""))


def _kept(name: str, error: KeyboardInterrupt, out: Path) -> str:
    """Write what an interruption has left of a table or figure, and return a sentence about it."""
    if not isinstance(error, Halfway) or not error.runs:
        return f"{name} is not finished"
    path = write_csv(out / f"{name}-interrupted.csv", *error.finished)
    return f"{counted(error.runs, 'run', 'runs')} of {name} were finished, their exits are in {path}"


@dataclass(frozen=True)
class _Selection:
    """What is to be done, all of it checked."""

    parts: Sequence[tuple[Paper[Any], Mapping[str, Settings]]]  # papers, each with the settings of its chosen figures
    store: Store
    workers: int
    fresh: bool
    ray: bool = False

    @property
    def names(self) -> list[str]:
        """The chosen figures, in the order of the results."""
        return [name for _, settings in self.parts for name in settings]

    def executor(self) -> Executor:
        """Return what computes; a cluster is connected to."""
        if self.ray:
            return make_executor("ray")
        return make_executor("serial") if self.workers == 1 else make_executor("processes", workers=self.workers)

    def results(self, executor: Executor) -> Iterator[Result]:
        """Yield one result after the other."""
        for paper, settings in self.parts:
            figures = {name: paper.figures[name] for name in settings}
            made_of = {name: figure.runs(settings[name]) for name, figure in figures.items() if figure.runs is not None}
            records = self._records([run for runs in made_of.values() for run in runs], executor)
            for name, figure in figures.items():
                yield _run(name, figure, settings[name], records, executor if self.ray else None)

    def _records(self, runs: list[Any], executor: Executor) -> Mapping[Any, Any]:
        """Return what comes of runs, each computed once, or taken from the folder."""
        if not runs:
            return {}
        with progress_bar("runs", len(distinct(runs))) as progress:
            return complete(runs, self.store, executor=executor, fresh=self.fresh, progress=progress)


def _select(name: str, given: Mapping[str, Any], out: Path) -> _Selection:
    """Return what is to be done.

    An option goes to all the chosen figures that take it.

    Raises
    ------
    ValueError
        In one sentence, if a name or an option is wrong or belongs to nothing that is chosen.
    """
    chosen = find(name)
    for option in given:
        if not any(FIGURES[figure].takes(option) for figures in chosen.values() for figure in figures):
            raise ValueError(f"{flag(option)} belongs to {_owners(option)}; {name} has no use for it")
    parts = []
    for key, figures in chosen.items():
        settings = {figure: PAPERS[key].settings_of(figure, given) for figure in figures}
        PAPERS[key].check(settings)
        parts.append((PAPERS[key], settings))
    workers = given.get("workers", all_cores())
    if workers < 1:
        raise ValueError(f"--workers is {workers}; it must be at least 1")
    if "workers" in given and "ray" in given:
        raise ValueError(f"--workers is {workers} beside --ray: processes of this machine, or a cluster; leave one out")
    check_folder("--out", out)
    return _Selection(parts, Store(out / "runs"), workers, given.get("fresh", False), given.get("ray", False))


def _owners(option: str) -> str:
    """Return in words which figures take an option: "table5 and lin (all but lin-fig5)"."""
    owners = []
    for key, paper in PAPERS.items():
        takers = [name for name, figure in paper.figures.items() if figure.takes(option)]
        others = [name for name in paper.figures if name not in takers]
        if len(takers) > len(others):
            owners.append(key + (f" (all but {', '.join(others)})" if others else ""))
        else:
            owners += takers
    return " and ".join([", ".join(owners[:-1]), owners[-1]] if owners[:-1] else owners)


def _run(
    name: str, figure: Figure[Any], settings: Settings, records: Mapping[Any, Any], far: Executor | None
) -> Result:
    steps = 0 if figure.steps is None else figure.steps(settings)
    with progress_bar(name, steps) as progress:
        return figure.reproduce(settings, Work(progress, records, far))


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
