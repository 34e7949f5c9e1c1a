"""Options that commands about policies share."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import typer

from crowd_env.agents import POLICIES, PRETRAINED
from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.tasks import TASKS
from crowd_env.cli.console import OF_PEOPLE, OF_PLACE, OF_RUNS, complete_from
from crowd_env.cli.place import split_changes
from crowd_env.routing.strategies import STRATEGIES
from crowd_env.scenarios import SCENARIOS

Place = Annotated[
    str | None,
    typer.Option(
        "--task",
        "--scenario",
        metavar="NAME",
        autocompletion=complete_from((*TASKS, *SCENARIOS)),
        rich_help_panel=OF_PLACE,
        help=f"A task: {', '.join(TASKS)}; or a scenario, its file, or a floor plan.",
    ),
]
People = Annotated[
    int | None,
    typer.Option(help="Another number of people of the same kinds.", min=1, rich_help_panel=OF_PEOPLE),
]
Policies = Annotated[
    list[str] | None,
    typer.Option(
        "--policies",
        "--policy",
        metavar="POLICY ...",
        autocompletion=complete_from((RULE, *STRATEGIES, *POLICIES, *PRETRAINED)),
        help="rule: the strategy of a task; shortest, nearest, fastest, comfortable; a route or exit; rules: the shortest path "
        f"with the scenario's control rules in force; {', '.join(POLICIES)}; a shipped policy (TASK/NAME), or the path of a "
        "network (.safetensors).",
    ),
]
Threads = Annotated[int, typer.Option(help="Of the simulation; results do not depend on it.", rich_help_panel=OF_RUNS)]


def changes(texts: Sequence[str] | None, kinds: Mapping[str, Any]) -> dict[str, Any]:
    """Return what --set changes: NAME=VALUE, each turned into what ``kinds`` says of its name.

    Raises
    ------
    ValueError
        If one has another form, an unknown name, or a value that is none of its kind.
    """
    found = {}
    for name, value in split_changes(texts).items():
        if name not in kinds:
            raise ValueError(f"--set {name}: nothing has this name; names are {', '.join(kinds)}")
        try:
            found[name] = kinds[name](value)
        except ValueError:
            raise ValueError(f"--set {name}={value}: this cannot be its value") from None
    return found
