"""The command ``crowd-env clogging``."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.analysis.clogging import Clogging, RunExits, cells, clogging
from crowd_env.analysis.exit_times import read_exits, write_gaps
from crowd_env.analysis.results.folder import CONFIG, EXITS
from crowd_env.cli.console import show_table
from crowd_env.cli.options import AsJson, new_app, plain
from crowd_env.core.console import check_folder, friendly_errors, say
from crowd_env.core.files.json_file import read_json
from crowd_env.rendering.libraries import require_libraries

app = new_app()

_BLOCKED_AFTER = 120.0  # s, where the place does not say it
_SOURCES = (
    "Folder of crowd-env run --out, or CSV file of recorded exits, columns time and run, if there are several (out = 0: "
    "watched until then with people inside); several compare."
)

EXAMPLES = """Examples:

crowd-env run lin-room-v0 --scheme hertz --set speed=1.5 --runs 10 --out room

crowd-env clogging room

crowd-env clogging room experiment.csv --out clogging

crowd-env clogging hall --per-exit
"""


@app.command("clogging", epilog=EXAMPLES)
def clog(
    sources: Annotated[list[Path], typer.Argument(metavar="DIR|FILE...", help=_SOURCES)],
    pause: Annotated[float, plain("A gap of this many seconds ends a burst.")] = 2.0,
    per_exit: Annotated[bool, plain("Gaps between people who took the same exit.", names=("--per-exit",))] = False,
    out: Annotated[Path | None, plain("Folder for gaps.csv and survival.png.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure how a crowd clogs: gaps between exits, bursts, and the exponent of the tail of the gaps.

    The last gap of a run that ends with people inside is open, longer than what was seen: it is counted beside the closed ones.
    """
    with friendly_errors():
        if out is not None:
            check_folder("--out", out)
            require_libraries(".png")
        names = [source.name for source in sources]
        sets, found = {}, {}
        for source, name in zip(sources, names, strict=True):
            name = name if names.count(name) == 1 else str(source)
            sets[name] = read_exits(source / EXITS if source.is_dir() else source)
            found[name] = clogging(sets[name], pause=pause, per_exit=per_exit, blocked_after=_blocked_after(source))
        paths = [] if out is None else _write(out, found, sets, per_exit)
    if as_json:
        typer.echo(json.dumps({"sets": [{"name": name, **each.as_json()} for name, each in found.items()]}))
    else:
        show_table("", {name: cells(each) for name, each in found.items()}, sections=(3, 9, 12))
        for name, each in found.items():
            typer.echo(f"* {name}: {each.statement()}." if len(found) > 1 else f"{each.statement()}.")
    if paths:
        say(f"files: {', '.join(str(path) for path in paths)}")


def _blocked_after(source: Path) -> float:
    """Return after how long without anyone out an exit counts as blocked [s]."""
    after = float(read_json(source / CONFIG)["blocked_after"]) if source.is_dir() else math.inf
    return after if math.isfinite(after) else _BLOCKED_AFTER


def _write(out: Path, found: dict[str, Clogging], sets: Mapping[str, Sequence[RunExits]], per_exit: bool) -> list[Path]:
    from crowd_env.rendering import save_figure, survival_curves

    try:
        paths = [write_gaps(out / "gaps.csv", sets, per_exit=per_exit)]
        if any(each.gaps.closed.any() for each in found.values()):
            title = next(iter(found)) if len(found) == 1 else "Gaps between exits"
            labels = {"all runs" if len(found) == 1 else name: each for name, each in found.items()}
            paths.append(save_figure(survival_curves(labels, title=title), out / "survival.png"))
        else:
            say("no figure: there is no gap to draw", "yellow")
    except OSError as error:
        raise ValueError(f"cannot write the results: {error}") from None
    return paths
