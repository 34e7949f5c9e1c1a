"""Options that commands about policies share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

from crowd_env.agents import POLICIES, PRETRAINED
from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.tasks import TASKS
from crowd_env.agents.training_config import GENERATED
from crowd_env.cli.options import of_people, of_place, of_runs, plain, section
from crowd_env.cli.place import split_changes
from crowd_env.routing.strategies import STRATEGIES
from crowd_env.scenarios import SCENARIOS

of_learning = section("Learning")

_PLACE = f"A task: {', '.join(TASKS)}, generated (places without end); or a scenario, its file, or a floor plan."
Place = Annotated[str | None, of_place(_PLACE, names=("--task", "--scenario"), among=(*TASKS, GENERATED, *SCENARIOS))]
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
