"""Film what a policy has learned beside the rule, on the same people: ``crowd-env show``."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import typer

from crowd_env import Scenario
from crowd_env.agents import POLICIES, PRETRAINED
from crowd_env.agents.evaluation.entries import RULE, Entry, make_entries
from crowd_env.agents.evaluation.evaluation import HELD_OUT_SEED
from crowd_env.agents.tasks import TASKS, Task, make_task
from crowd_env.cli.agents.lists_of_names import ListsOfNames
from crowd_env.cli.options import complete_from, of_output, plain
from crowd_env.cli.recorded import FilmFps, FilmSpeed, FilmWidth, film_file, size_of
from crowd_env.core.checks import Range, whole
from crowd_env.core.console import friendly_errors, progress_bar, say
from crowd_env.envs.rollout import Driver

# Task -> a draw in which people who follow the rule block their way out for good; 0 where none is known.
DRAWS: Mapping[str, int] = MappingProxyType({"competitive-door": 2})

_TASK = f"What people have to do: {', '.join(TASKS)}."
_WHO = "Who are shown, from left to right; the names are those of `crowd-env evaluate`."
_OF_TASK = "rule and what was learned for the task"
_NAMES = (RULE, *POLICIES, *PRETRAINED)
_BLOCKED = "one in which the rule blocks the door, or 0"

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command(cls=ListsOfNames)
def main(
    task: Annotated[
        str, typer.Argument(metavar="TASK", autocompletion=complete_from(TASKS), help=_TASK)
    ] = "competitive-door",
    policies: Annotated[
        list[str] | None, plain(_WHO, _OF_TASK, names=("--policies", "--policy"), among=_NAMES, metavar="POLICY ...")
    ] = None,
    seed: Annotated[int | None, plain("Which held-out draw of the people.", _BLOCKED)] = None,
    film: Annotated[Path | None, of_output("Where: .mp4 or .gif.", "TASK.mp4 here")] = None,
    film_width: FilmWidth = None,
    film_fps: FilmFps = None,
    film_speed: FilmSpeed = None,
) -> None:
    """Film how people walk out of a task: as the rule says, and beside it as a shipped policy does.

    Examples
    --------
    crowd-env show competitive-door

    crowd-env show competitive-door --policies rule follow competitive-door/ppo --seed 5 --film door.gif
    """
    with friendly_errors():
        chosen = make_task(task)
        if seed is None:
            seed = DRAWS.get(task, 0)
        whole("--seed", seed, Range(0, HELD_OUT_SEED - 1))
        place = chosen.place()
        entries = make_entries(policies or _of_task(task), place, chosen)
        path = film_file("--film", Path(task) if film is None else film, task)

        from crowd_env.agents.evaluation.side_by_side import RULE_AHEAD, record_beside, write_beside

        titles = [RULE_AHEAD if one.name == RULE else one.name.replace(f"{task}/", "learned: ") for one in entries]
        ways = {title: partial(_driver, one, chosen) for title, one in zip(titles, entries, strict=True)}
        with progress_bar("evacuations", len(ways)) as progress:
            films = record_beside(ways, place, HELD_OUT_SEED + seed, progress)
        for one in films:
            inside = int(one.inside(one.end))
            told = f"{inside} still inside after" if inside else "all out after"
            typer.echo(f"{one.facts['shown_as']}: {told} {one.end:.1f} s")
        with progress_bar("film, frames") as progress:
            write_beside(path, films, width=film_width, fps=film_fps, speed=film_speed, progress=progress)
        say(f"film: {size_of(path)}")


def _of_task(task: str) -> list[str]:
    """Return the rule and the first policy that is shipped for a task."""
    learned = [name for name in PRETRAINED if name.startswith(f"{task}/")]
    if not learned:
        say(f"note: no policy is shipped for {task}: the rule alone")
    return [RULE, *learned[:1]]


def _driver(entry: Entry, task: Task, place: Scenario) -> Callable[[int], Driver]:
    return entry.driver(place, task.scheme, 1)
