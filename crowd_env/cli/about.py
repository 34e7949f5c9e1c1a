"""Commands about the program itself: the names that it knows, its kernels, and the schema of its files."""

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.cli.console import show_table
from crowd_env.cli.options import AsJson, WalkingName, new_app, plain
from crowd_env.cli.place import walking_of
from crowd_env.core.console import friendly_errors, progress_bar, say
from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.envs.tasks.task import TASKS
from crowd_env.physics import SCHEMES, make_scheme
from crowd_env.scenarios import SCENARIOS, make_scenario
from crowd_env.scenarios.profiles import PROFILES, speed_words

app = new_app()


@app.command("list")
def list_names(as_json: AsJson = False) -> None:
    """List the scenarios, tasks, contact schemes, occupant profiles and policies."""
    from crowd_env.agents import POLICIES, PRETRAINED

    places = {name: make_scenario(name) for name in SCENARIOS}
    names = {
        "scenarios": {name: f"{place.title} ({place.reference})" for name, place in places.items()},
        "tasks": {task.id: task.about for task in TASKS.values()},
        "contact schemes": {name: f"{one.info.title} ({one.info.reference})" for name, one in SCHEMES.items()},
        "occupant profiles": {
            name: f"{one.people}, {speed_words(one)} m/s ({one.source})" for name, one in PROFILES.items()
        },
        "policies": {**dict.fromkeys(POLICIES, "rule"), **dict.fromkeys(PRETRAINED, "trained network")},
    }
    if as_json:
        typer.echo(json.dumps({title.split()[-1]: found for title, found in names.items()}))
        return
    for title, found in names.items():
        show_table(title, {"": found})


@app.command()
def warmup(
    scheme: Annotated[list[str] | None, plain("Contact scheme; may be repeated.", "all", among=SCHEMES)] = None,
    walking: WalkingName = None,
    as_json: AsJson = False,
) -> None:
    """Compile the kernels now, so that the first step of every later program starts at once."""
    from crowd_env.envs.crowd import CrowdEnv

    seconds = {}
    with friendly_errors():
        chosen = [make_scheme(name) for name in scheme or SCHEMES]
        with progress_bar("compiling", len(chosen)) as progress:
            for law in chosen:
                begin = time.monotonic()
                env = CrowdEnv("room-v0", physics=law, walking=walking_of(walking))
                env.reset(seed=0)
                env.step(None)
                seconds[law.info.name] = round(time.monotonic() - begin, 2)
                progress(1)
    if as_json:
        typer.echo(json.dumps({"seconds": seconds}))
        return
    for name, spent in seconds.items():
        typer.echo(f"{name:14s} {spent:6.2f} s")


@app.command()
def schema(out: Annotated[Path | None, plain("File to write, .json.", "print it")] = None) -> None:
    """Give the JSON Schema of scenario files, with which editors complete keys and mark mistakes."""
    with friendly_errors():
        from crowd_env.scenarios.schema import json_schema

        text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
        if out is None:
            typer.echo(text)
            return
        write_text(check_suffix(out, (".json",)), text + "\n")
        say(f"schema: {out}")
