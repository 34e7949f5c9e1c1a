"""Options that commands about policies share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

from crowd_env.agents import POLICIES, PRETRAINED
from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.tasks import TASKS, make_task
from crowd_env.agents.training_config import GENERATED
from crowd_env.cli.options import of_people, of_place, of_runs, plain, section
from crowd_env.cli.place import split_changes
from crowd_env.envs.tasks.task import named_task
from crowd_env.routing.strategies import STRATEGIES
from crowd_env.scenarios import SCENARIOS

of_learning = section("Learning")

_TASK = f"What is to be done: {', '.join(TASKS)}, or generated (places without end)."
TaskName = Annotated[str | None, of_place(_TASK, names=("--task",), among=(*TASKS, GENERATED))]
_PLACE = "In place of a task a scenario, its file, or a floor plan."
PlaceName = Annotated[str | None, of_place(_PLACE, names=("--scenario",), among=SCENARIOS)]
People = Annotated[int | None, of_people("Another number of people of the same kinds.", min=1)]
_POLICIES = (
    "rule: the strategy of a task; shortest, nearest, fastest, comfortable; a route or exit; rules: the shortest path "
    f"with the scenario's control rules in force; {', '.join(POLICIES)}; a shipped policy (TASK/NAME), or the path of a "
    "network (.safetensors)."
)
_KNOWN = (RULE, *STRATEGIES, *POLICIES, *PRETRAINED)
Policies = Annotated[
    list[str] | None, plain(_POLICIES, names=("--policies", "--policy"), among=_KNOWN, metavar="POLICY ...")
]
Threads = Annotated[int, of_runs("Of the simulation; results do not depend on it.")]
OneTask = Annotated[str, plain(f"The task: {', '.join(TASKS)}.", among=TASKS)]


def task_or_place(task: str | None, scenario: str | None) -> str | None:
    """Return the name of the task, or of the place, that a command line names; None if it names nothing.

    Raises
    ------
    ValueError
        If both are given, there is no such task, or the place is that of a task.
    """
    if task is not None and scenario is not None:
        raise ValueError(f"--task {task} beside --scenario {scenario}: give one of them")
    if task not in (None, GENERATED):
        return make_task(str(task)).name
    if named_task(scenario) is not None:
        raise ValueError(f"unknown scenario {scenario!r}; this is a task: say --task {scenario}")
    return task or scenario


def changes(texts: Sequence[str] | None, kinds: Mapping[str, Callable[[str], object]]) -> dict[str, Any]:
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
