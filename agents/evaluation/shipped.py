"""What the rules did on the held-out draws of a task, shipped with it: nothing that is trained changes that.

``tasks/rules/TASK/RULE.npz`` holds when people got out and what was measured of each run, in single precision: no maps, and of
ways the means alone.  ``crowd-env rules`` makes it.  It is good for a task of the same digest, where the code does the same:
before it is used, every rule leads a few people out anew.  A hash of the sources would refuse it after every comment, and miss
a new version of NumPy.

Another processor may round otherwise.  There the rest of a draw would come out otherwise, as likely as what is shipped.  Times
of computing are those of the computer that made it.
"""

import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from crowd_env import Scenario, make_scheme
from crowd_env.core.console import say
from crowd_env.core.executors import Executor, Processes
from crowd_env.core.files.store import Store
from crowd_env.envs.tasks.task import HELD_OUT_SEED, Task, make_task
from crowd_env.physics import ContactScheme

from .. import POLICIES, PRETRAINED
from ..walking import RuleAtShare
from .entries import RULE, make_entries, policy_entry
from .evaluation import Evaluation
from .folder import EvaluationFolder, content_of, evaluation_of, settings_of
from .goals import strayed
from .same_draws import compare

FOLDER = Path(__file__).parents[1] / "tasks/rules"
OF_TASK = (RULE, *(name for name in POLICIES if name not in ("shortest", "stand-still", "random")))
# Before they are used, so many draws are begun anew, until so many people of each are out: not later, since rounding grows.  In
# four tasks, places that differed by 1e-14 made 2e-4 s by then at most, and whole seconds after 15 people.
_DRAWS, _PEOPLE, _ALIKE = 3, 5, 1e-3


def shipped(task: Task, place: Scenario, law: ContactScheme, runs: int) -> dict[str, Evaluation]:
    """Return what ships of the rules in the first ``runs`` draws of a task.

    It is nothing where place or law are not the task's, or where another version or other code made what ships.
    """
    found: dict[str, Evaluation] = {}
    if law.info.name != task.scheme or settings_of(place, runs, 0) != settings_of(task.place(), runs, 0):
        return found
    with suppress(ValueError):  # of another version
        store = Store(FOLDER / task.name, task.identity())
        for name in OF_TASK:
            if (kept := store.load(name)) is not None and len(kept["ended"]) >= runs:
                first = {key: _first(key, value, runs) for key, value in kept.items()}
                if "density" not in kept:  # made when walls were taken for floor: it stands beside no density of now
                    first["max_density"] = np.full(runs, np.nan)
                found[name] = evaluation_of(name, task.scheme, first)
    if not all(_does_so(task, result) for result in found.values()):
        say(f"what ships of the rules in {task.name} was made by code that does other things: computing it anew ...")
        return {}
    if found:
        say(f"what ships of {len(found)} rules in {task.name} is taken; --fresh computes it here")
    return found


def _first(name: str, value: object, runs: int) -> object:
    """Return what is kept of the first runs, in double precision."""
    if not isinstance(value, np.ndarray) or name == "maps":
        return value
    return value[:runs].astype(np.float64) if value.dtype == np.float32 else value[:runs]


def _does_so(task: Task, result: Evaluation) -> bool:
    """Return whether a rule lets the first people of some draws out when it did."""
    place, name = task.place(), result.policy
    (entry,) = make_entries([name], place, task)
    if name == RuleAtShare.name:  # not to look for its share again
        entry = policy_entry(RuleAtShare(**result.constants), task)
    draws = min(_DRAWS, result.runs)
    driver = entry.driver(place)(draws)
    there = np.sort(result.exit_times[:draws])[:, :_PEOPLE]
    driver.reset([HELD_OUT_SEED + k for k in range(draws)])
    state, until = driver.env.simulation.state, np.max(there, where=np.isfinite(there), initial=0.0)
    while state.time.max() < until and not driver.env.finished.all():
        driver.step()
    stray = strayed(state.exit_index.reshape(draws, -1), place)
    here = np.sort(np.where(stray, np.nan, state.exit_time.reshape(draws, -1)))[:, :_PEOPLE]
    return np.allclose(here, there, rtol=0.0, atol=_ALIKE, equal_nan=True)


def ship(task: Task, runs: int | None = None, executor: Executor | None = None) -> None:
    """Compute and write what ships of the rules in a task; what is still good stays.

    What was finished before an interruption is kept in ``runs/``.
    """
    place, runs = task.place(), task.runs if runs is None else runs
    folder = EvaluationFolder(Path("runs") / f"rules-{task.name}", settings_of(place, runs, 0, task))
    if not (good := shipped(task, place, make_scheme(task.scheme), runs)):
        shutil.rmtree(FOLDER / task.name, ignore_errors=True)
    entries = make_entries([name for name in OF_TASK if name not in good], place, task)
    results = compare(entries, place, [task.scheme], runs=runs, folder=folder, executor=executor)
    store = Store(FOLDER / task.name, task.identity())
    for result in results:
        kept = content_of(result)
        content = {**kept, "walked": kept["walked"].mean(axis=1, keepdims=True), "maps": np.zeros((4, 0, 0))}
        content["density"] = "of floor alone"
        store.keep(result.policy, {key: _single(value) for key, value in content.items()})


def _single(value: object) -> object:
    """Return arrays of numbers in single precision."""
    return value.astype(np.float32) if isinstance(value, np.ndarray) and value.dtype == np.float64 else value


def ship_rules(tasks: Sequence[str] | None = None) -> None:
    """Make what ships of the rules in these tasks, by default in those with a shipped policy."""
    with_policy = dict.fromkeys(one.partition("/")[0] for one in PRETRAINED if "/" in one)
    for task in [make_task(name) for name in tasks or with_policy]:
        ship(task, executor=Processes())
