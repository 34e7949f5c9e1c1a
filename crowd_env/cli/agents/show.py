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
from crowd_env.agents.tasks import TASKS, Task, make_task
from crowd_env.cli.agents.lists_of_names import ListsOfNames
from crowd_env.cli.options import Exits, PeopleCount, Unit, complete_from, new_app, of_output, plain
from crowd_env.cli.place import CrowdOptions, read_place
from crowd_env.cli.recorded import FilmFps, FilmWidth, film_file, size_of
from crowd_env.core.checks import Range, whole
from crowd_env.core.console import friendly_errors, progress_bar, say
from crowd_env.envs.rollout import Driver
from crowd_env.envs.tasks.task import HELD_OUT_SEED, named_task
from crowd_env.scenarios import SCENARIOS

# Task -> a draw in which people who follow the rule block their way out for good; 0 where none is known.
DRAWS: Mapping[str, int] = MappingProxyType({"competitive-door": 2})

_TASK = f"What people have to do: {', '.join(TASKS)}; or a place: a scenario, its file, or a floor plan."
_WHO = "Who are shown, from left to right; the names are those of `crowd-env evaluate`."
_OF_TASK = "rule and what was learned for the task; of a place how people walk by themselves"
_NAMES = (RULE, *POLICIES, *PRETRAINED)
_BLOCKED = "one in which the rule blocks the door, or 0"

app = new_app()


@app.command(cls=ListsOfNames)
def main(
    task: Annotated[
        str, typer.Argument(metavar="TASK", autocompletion=complete_from(TASKS), help=_TASK)
    ] = "competitive-door",
    policies: Annotated[
        list[str] | None, plain(_WHO, _OF_TASK, names=("--policies", "--policy"), among=_NAMES, metavar="POLICY ...")
    ] = None,
    people: PeopleCount = None,
    exit: Exits = None,
    unit: Unit = None,
    seed: Annotated[int | None, plain("Which held-out draw of the people.", _BLOCKED)] = None,
    film: Annotated[Path | None, of_output("Where: .mp4 or .gif.", "TASK.mp4 here")] = None,
    film_width: FilmWidth = None,
    film_fps: FilmFps = None,
) -> None:
    """Film how people walk out of a task: as the rule says, and beside it as a shipped policy does.

    Examples
    --------
    crowd-env show competitive-door

    crowd-env show competitive-door --policies rule follow competitive-door/ppo --seed 5 --film door.gif

    crowd-env show narrow-door --film door.gif --film-width 480 --film-fps 10

    crowd-env show examples/office.dxf --people 40 --policies fastest competitive-door/ppo
    """
    with friendly_errors():
        chosen = named_task(task) or (None if _is_place(task) else make_task(task))
        task = name = task if chosen is None else chosen.name
        seed = whole("--seed", DRAWS.get(task, 0) if seed is None else seed, Range(0, HELD_OUT_SEED - 1))
        if chosen is None:
            place = read_place(CrowdOptions(scenario=task, exit=exit, unit=unit, people=people))
            name = place.name
            entries = make_entries(policies or [place.strategy_of_run()], place)
        else:
            place = chosen.place(people)
            entries = make_entries(policies or _of_task(task), place, chosen)
        path = film_file("--film", Path(name) if film is None else film, name)

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
            write_beside(path, films, width=film_width, fps=film_fps, progress=progress)
        say(f"film: {size_of(path)}")


def _is_place(name: str) -> bool:
    return name in SCENARIOS or (name != "" and Path(name).exists())


def _of_task(task: str) -> list[str]:
    """Return the rule and the first policy that is shipped for a task."""
    learned = [name for name in PRETRAINED if name.startswith(f"{task}/")]
    if not learned:
        say(f"note: no policy is shipped for {task}: the rule alone")
    return [RULE, *learned[:1]]


def _driver(entry: Entry, task: Task | None, place: Scenario) -> Callable[[int], Driver]:
    return entry.driver(entry.suited(place) if task is None else place).settled()
