"""The command ``python -m validation``."""

import json
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.status import Status
from rich.table import Table
from typer.core import TyperGroup

from crowd_env import SCHEMES, make_scheme
from crowd_env.core.behaviors.headway import MANNERS, Headway
from crowd_env.core.behaviors.outline import OUTLINES, Outline
from crowd_env.core.checks import known
from crowd_env.core.console import check_folder, friendly_errors, notes, say
from crowd_env.physics.settings import check_behaviors
from validation.cases import CASES
from validation.cases.case import COMPARED, DISC, Row, Setting
from validation.cases.case import row as row_of
from validation.finished import Finished, complete_rows, of_bodies
from validation.pages import ROOT, fill_pages
from validation.pictures import DATA, commands, remade
from validation.sources import Source, run
from validation.tables import MAKERS, make

_WIDTH = 140  # characters, where there is no terminal
_SCHEMES = f"Contact scheme: {', '.join(SCHEMES)}; may be repeated; default {', '.join(COMPARED)}, of these."
_MANNER = f"How people walk: {', '.join(MANNERS)}; may be repeated; default those of the case."
_OUTLINE = f"Shape of all bodies: {', '.join(OUTLINES)}; other than discs under schemes that turn bodies alone."
_DATA = "Folder with the recordings, which are not part of the repository."
_DRAWS = "Crowds of each experiment; default as many as the case takes."
_SEED = "Of the crowds, which are the same for every scheme and manner."
_QUICK = "The case laws under dem alone, in a minute or two: what runs with the tests."
_OUT = "Folder for CASE/SCHEME-MANNER.json, and for pictures; what is finished there is not run again."
_PICTURES = ROOT / "build/pictures"
_PASSED = {True: "yes", False: "NO", None: "–"}


class _CasesUnlessNamed(TyperGroup):
    """A group in which words that name none of its commands are those of ``cases``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        named = bool(args) and args[0] in (*self.commands, "--help")
        return super().parse_args(ctx, args if named else ["cases", *args])


app = typer.Typer(cls=_CasesUnlessNamed, add_completion=False, pretty_exceptions_enable=False)


@app.callback()
def _about() -> None:
    """Is it true: simulations beside what is known about crowds.

    python -m validation [CASE ...] [OPTIONS] is python -m validation cases [CASE ...] [OPTIONS].
    """


@app.command()
def cases(
    case: Annotated[list[str] | None, typer.Argument(help=f"Cases: {', '.join(CASES)}; default all.")] = None,
    schemes: Annotated[list[str] | None, typer.Option(help=_SCHEMES)] = None,
    manner: Annotated[list[str] | None, typer.Option(help=_MANNER)] = None,
    outline: Annotated[str, typer.Option(help=_OUTLINE)] = DISC,
    data: Annotated[Path | None, typer.Option(help=_DATA)] = None,
    draws: Annotated[int | None, typer.Option(help=_DRAWS, min=1)] = None,
    seed: Annotated[int, typer.Option(help=_SEED, min=0)] = 0,
    quick: Annotated[bool, typer.Option("--quick", help=_QUICK)] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object a case, each on a line.")] = False,
    out: Annotated[Path | None, typer.Option(help=_OUT)] = None,
) -> None:
    """Hold simulations against recordings, laws and bounds: rows for each scheme and manner; exit code 1 if one does not pass.

    Everyone is of one population and one set of parameters a manner, whatever the case.

    Example: python -m validation gate --data DIR --schemes dem --schemes nsm2 --manner hurried
    """
    passed = True
    with friendly_errors("" if out is None else f"the rows that were finished are in {out}/"):
        if quick and (case or schemes):
            raise ValueError("--quick is one case and one scheme; give no others")
        if quick:
            case, schemes = ["laws"], ["dem"]
        for name in case or ():
            known("case", name, CASES)
        for name in manner or ():
            Headway.of(name)
        if data is not None and not data.exists():
            raise ValueError(f"--data {data}: no such folder")
        if out is not None:
            check_folder("--out", out)
        finished = None if out is None else Finished(out)
        common = Setting(seed=seed, data=data, outline=outline)
        for name, runs in _plan(case, schemes, manner, draws, common, finished):
            found: list[Row] = []
            with notes.status(f"{name} ...") as status:
                notify = _teller(name, status)
                for setting, there in runs:
                    notify(f"{setting.scheme}, {setting.manner}" + (": finished before" if there is not None else ""))
                    found += _run(name, replace(setting, notify=notify), finished) if there is None else there
            draw = CASES[name].draw
            if out is not None and draw is not None:
                place = of_bodies(out, outline)
                draw(place, complete_rows(place, name))
            passed &= all(one.passed is not False for one in found)
            if as_json:
                typer.echo(json.dumps({"case": name, "rows": [one._asdict() for one in found]}))
            else:
                Console(width=None if notes.is_terminal else _WIDTH).print(_case_table(name, outline, found))
    raise typer.Exit(0 if passed else 1)


def _run(name: str, setting: Setting, finished: Finished | None) -> list[Row]:
    """Return the rows of a case; one that says why, if the scheme refuses to go on with a crowd.  Keep each as it comes."""
    rows: list[Row] = []
    began = time.process_time()

    def keep(complete: bool) -> None:
        if finished is not None and rows:
            finished.keep_rows(name, setting, rows, complete, time.process_time() - began)

    try:
        for one in CASES[name].run(setting):
            rows.append(one)
            keep(False)
    except FloatingPointError as error:
        figure = f"stopped: {error}"
        rows.append(row_of(name, setting, False, figure, "the run comes to its end", CASES[name].source))
    keep(True)
    return rows


def _plan(
    cases: list[str] | None,
    schemes: list[str] | None,
    manners: list[str] | None,
    draws: int | None,
    common: Setting,
    finished: Finished | None,
) -> list[tuple[str, list[tuple[Setting, list[Row] | None]]]]:
    """Return the cases that are meant, each under its schemes and manners, with the rows of those that are finished.

    Raises
    ------
    ValueError
        If a case or scheme that is named cannot have these bodies, or finished rows are those of another run.
    """
    shape = Outline.of(common.outline)
    for name in cases or () if shape is not None else ():
        if why := CASES[name].discs_because:
            raise ValueError(f"{name} has no bodies of outline {common.outline!r}: {why}")
    for name in schemes or ():
        check_behaviors({"outline": shape}, make_scheme(name))
    under = schemes or [name for name in COMPARED if shape is None or SCHEMES[name].turns_bodies]
    plan = []
    for name in cases or [name for name, case in CASES.items() if shape is None or not case.discs_because]:
        case = CASES[name]
        mine = replace(common, draws=draws or case.draws, data=common.data if case.recordings else None)
        runs = [replace(mine, scheme=scheme, manner=manner) for scheme in under for manner in manners or case.manners]
        plan.append((name, [(one, None if finished is None else finished.rows(name, one)) for one in runs]))
    return plan


def _teller(case: str, status: Status) -> Callable[[str], None]:
    """Return what tells of progress: on a terminal in place, else a line for each thing."""

    def notify(text: str) -> None:
        if notes.is_terminal:
            status.update(f"{case}: {text}")
        else:
            say(f"{case}: {text}")

    return notify


def _case_table(name: str, outline: str, found: list[Row]) -> Table:
    """Return the rows of a case as a table; criterion and source below it if all rows share them."""
    criteria = dict.fromkeys((one.criterion, one.source) for one in found)
    shared = len(criteria) == 1
    caption = "\n".join(next(iter(criteria))) if shared else CASES[name].source
    title = f"{name}: {CASES[name].title}" + (f"; bodies: {outline}" if outline != DISC else "")
    table = Table(title=title, caption=escape(caption), box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("scheme", "manner", "passed", *(("figure",) if shared else ("test", "figure", "criterion"))):
        table.add_column(column, no_wrap=column in ("scheme", "manner", "passed"))
    for one in found:
        words = (one.figure,) if shared else (one.source, one.figure, one.criterion)
        table.add_row(one.scheme, one.manner, _PASSED[one.passed], *map(escape, words))
    return table


@app.command()
def pages(
    names: Annotated[
        list[str] | None, typer.Argument(help=f"Tables to make anew first: {', '.join(MAKERS)}; default none.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--from", help="Folder that a finished run has written, for tables that need one.")
    ] = None,
) -> None:
    """Put the tables of docs/tables/ into the pages of docs/; make some of them anew before.

    docs/tables/made_by.csv says of each table by which command its figures are measured; --from names the folder that a long
    one has written.

    Examples:  python -m validation pages clogging;  python -m validation pages measured criteria map --from DIR
    """
    with friendly_errors(), notes.status("pages ...") as status:

        def command(line: str) -> dict[str, Any]:
            status.update(f"python -m {line}")
            return run(line)

        make(names or (), Source(command, folder))
        for page in fill_pages():
            typer.echo(page.relative_to(ROOT))


@app.command()
def pictures(
    names: Annotated[list[str] | None, typer.Argument(help="Pictures of docs/images/; default all.")] = None,
    data: Annotated[Path | None, typer.Option(help=f"{_DATA}  Without it theirs are left out.")] = None,
    out: Annotated[Path, typer.Option(help="Folder to work in; what lies there is not made again.")] = _PICTURES,
) -> None:
    """Make the pictures of the pages again, by the commands of docs/tables/made_by.csv; exit code 1 if one was not made.

    An interrupted command goes on where it was.  Where a program has changed, name another folder or delete this one.

    Example:  python -m validation pictures office.png lin-fig7.png --data DATA --out build/pictures
    """
    failed = False
    with friendly_errors(f"the pictures that were finished are in {out}/"):
        found = commands()
        for name in names or ():
            known("picture", name, (name for made in found.values() for name in made))
        jobs = [(command, made) for command, made in found.items() if not names or {*names} & {*made}]
        for k, (command, made) in enumerate(jobs, start=1):
            left_out = data is None and DATA in command
            say(f"{k} of {len(jobs)}: {', '.join(made)}{': left out, it needs --data' if left_out else ''}")
            try:
                for there, new in () if left_out else remade(command, made, out, data).items():
                    there.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(new, there)
            except ValueError as error:
                failed = True
                say(f"error: {error}", "red")
    raise typer.Exit(int(failed))


def main() -> None:
    """Run the command line."""
    app()
