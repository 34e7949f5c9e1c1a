"""The command ``crowd-env report``."""

import json
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.analysis.results.config import file_digest
from crowd_env.cli.console import check_picture
from crowd_env.cli.options import AsJson, new_app, of_output
from crowd_env.cli.place import CrowdOptions, setting_of
from crowd_env.core.checks import Plain
from crowd_env.core.console import check_place, friendly_errors, say
from crowd_env.core.files.atomic import check_suffix
from crowd_env.core.files.own import names_own
from crowd_env.physics import ContactScheme
from crowd_env.rendering.report.figures import differences
from crowd_env.rendering.report.maps import measure
from crowd_env.rendering.report.runs import load_runs, remarks_on
from crowd_env.scenarios.scenario import Scenario

app = new_app()


def place_of(config: Plain, trust_code: bool = False) -> tuple[Scenario, ContactScheme]:
    """Return what a config stands for.

    Raises
    ------
    ValueError
        If it names no place, a file that is another now, or, without ``trust_code``, a law or a policy in a file of code.
    """
    options = CrowdOptions.of_config(config["arguments"])
    own = [text for text in (options.scheme, options.policy) if text and names_own(text)]
    if own and not trust_code:
        raise ValueError(f"they were made with the code {own[0]}, which a report would run; allow it by --trust-code")
    try:
        setting = setting_of(options)
    except ValueError:
        for file in options.files().values():
            recorded = config.get("files", {}).get(str(file.absolute()))
            if file.is_file() and file_digest(file) != recorded:  # a message may hold some of its content
                raise ValueError(f"{file} is not the file that they were made with") from None
        raise
    return setting.place, setting.physics.law


@app.command()
def report(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of crowd-env run --out; several are compared, with the first."),
    ],
    out: Annotated[Path, of_output("Page to write, .html.", names=("--out", "-o"))] = Path("report.html"),
    title: Annotated[str | None, of_output("Title of the page; default the place.")] = None,
    maps: Annotated[
        bool, of_output("Leave out the maps of recorded runs.", names=(" /--no-maps",), show_default=False)
    ] = True,
    trust_code: Annotated[
        bool, typer.Option("--trust-code", help="Run a law or a policy of your own, FILE.py:NAME, that a folder names.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make one web page to hand in: plan, people, assumptions, results with intervals, comparison, limits of validity.

    Examples: crowd-env run two-exit-hall-v0 --runs 20 --routing nearest --out nearest

    crowd-env run two-exit-hall-v0 --runs 20 --routing fastest --out fastest

    crowd-env report nearest fastest -o report.html --title "Nearest or fastest exit"

    crowd-env report mine --trust-code, where the runs had a law or a policy of your own
    """
    with friendly_errors():
        check_suffix(out, (".html",))
        check_place("--out", out)
        check_picture("--out", out.with_suffix(".png"), (".png",))  # the libraries that draw
        runs = load_runs(folders, partial(place_of, trust_code=trust_code))
        for remark in remarks_on(runs):
            say(f"note: {remark}", "yellow")
        measured = [of_one for one in runs if maps and (of_one := measure(one)) is not None]
        from crowd_env.rendering.report.page import write_report

        written = write_report(out, runs, measured=measured, title=title)
    if as_json:
        found = [{"name": one.name, "folder": str(one.folder), **one.figures} for one in runs]
        figures = {"runs": found, "differences": differences(runs), "maps": [one.as_json() for one in measured]}
        typer.echo(json.dumps({"report": str(written), **figures}))
        return
    say(f"report: {written} ({written.stat().st_size / 1e3:.0f} kB)")
