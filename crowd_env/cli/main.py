"""The command ``crowd-env``."""

import json
import time
from pathlib import Path
from typing import Annotated

import typer

import crowd_env
from crowd_env.cli.agents import WithLearning
from crowd_env.cli.clogging import EXAMPLES as CLOGGING_EXAMPLES
from crowd_env.cli.clogging import clog
from crowd_env.cli.console import show_table
from crowd_env.cli.options import AsJson, CrowdName, plain
from crowd_env.cli.plan import plan
from crowd_env.cli.recorded import film, forces, replay
from crowd_env.cli.report import report
from crowd_env.cli.reproduce import reproduce
from crowd_env.cli.run import EXAMPLES as RUN_EXAMPLES
from crowd_env.cli.run import run
from crowd_env.core.console import friendly_errors, progress_bar, say
from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.physics import SCHEMES, make_scheme
from crowd_env.scenarios import SCENARIOS, make_scenario

app = typer.Typer(cls=WithLearning, no_args_is_help=True, pretty_exceptions_enable=False)


def _say_version(asked: bool) -> None:
    if asked:
        typer.echo(f"crowd-env {crowd_env.__version__}")
        raise typer.Exit


@app.callback()
def say_about_itself(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_say_version)
    ] = False,
) -> None:
    """Crowds that really touch each other: run evacuations from the command line."""


app.command(epilog=RUN_EXAMPLES)(run)


@app.command("list")
def list_names(as_json: AsJson = False) -> None:
    """List the scenarios and contact schemes."""
    places = {name: make_scenario(name) for name in SCENARIOS}
    scenarios = {name: f"{place.title} ({place.reference})" for name, place in places.items()}
    schemes = {name: f"{scheme.info.title} ({scheme.info.reference})" for name, scheme in SCHEMES.items()}
    if as_json:
        typer.echo(json.dumps({"scenarios": scenarios, "schemes": schemes}))
        return
    for title, names in (("scenarios", scenarios), ("contact schemes", schemes)):
        show_table(title, {"": names})


for looking in (plan, film, replay, forces, report):
    app.command()(looking)


@app.command()
def warmup(
    physics: Annotated[list[str] | None, plain("Contact scheme; may be repeated.", "all", among=SCHEMES)] = None,
    crowd: CrowdName = None,
    as_json: AsJson = False,
) -> None:
    """Compile the kernels now, so that the first step of every later program starts at once."""
    from crowd_env.envs.crowd import CrowdEnv

    seconds = {}
    with friendly_errors():
        chosen = [make_scheme(name) for name in physics or SCHEMES]
        with progress_bar("compiling", len(chosen)) as progress:
            for scheme in chosen:
                begin = time.monotonic()
                env = CrowdEnv("room-v0", physics=scheme, walking=crowd)
                env.reset(seed=0)
                env.step(None)
                seconds[scheme.info.name] = round(time.monotonic() - begin, 2)
                progress(1)
    if as_json:
        typer.echo(json.dumps({"seconds": seconds}))
        return
    for name, spent in seconds.items():
        typer.echo(f"{name:14s} {spent:6.2f} s")


app.command()(reproduce)
app.command("clogging", epilog=CLOGGING_EXAMPLES)(clog)


@app.command()
def schema(out: Annotated[Path | None, typer.Option(help="File to write, .json; default: print it.")] = None) -> None:
    """Give the JSON Schema of scenario files, with which editors complete keys and mark mistakes."""
    with friendly_errors():
        from crowd_env.scenarios.schema import json_schema

        text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
        if out is None:
            typer.echo(text)
            return
        write_text(check_suffix(out, (".json",)), text + "\n")
        say(f"schema: {out}")


def main() -> None:
    """Run the command line."""
    app()
