"""The start of a training: full speed, a cloned rule, the result of a search, or the expert policies of all places."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from stable_baselines3 import PPO

from crowd_env.core.console import say
from crowd_env.core.files.json_file import read_json, write_json

from ..evaluation.entries import RULE
from ..training_config import NOTHING, TrainingConfig, physics_of, place_of, start_of
from ..walking import Evolved, WalkingRule
from .callbacks import EvaluationCallback
from .cloning import clone
from .evolution import evolve
from .generalist import distill

FOUND = "search.json"  # weights, in the folder of a run
MOST, SHOWN = 150, 20  # generations of a search, and between two rows of its curve

OnSearch = Callable[[int, Evolved], object]  # takes the number of decisions so far, and the present best policy


def begin(
    model: PPO, config: TrainingConfig, folder: Path | None = None, threads: int = 1, on_search: OnSearch | None = None
) -> None:
    """Give the policy of a new model the start of the config."""
    if config.places is not None:
        distill(model, config.places, config.seed, folder, threads)
        return
    rule = first_rule(config, folder, threads, on_search)
    if rule is not None:
        say(f"cloning {rule.name}, a fraction of a minute ...")
        clone(model, rule, config.seed)


def first_rule(
    config: TrainingConfig, folder: Path | None = None, threads: int = 1, on_search: OnSearch | None = None
) -> WalkingRule | None:
    """Return the rule that a training clones first; None: it starts at full speed.

    For the start "nothing" a search finds the rule, in a minute of one core.  The ``folder`` of a run keeps it, so that a
    resumed run does not search again.  ``on_search`` receives the best policy every `SHOWN` generations.
    """
    if config.start == RULE:
        return None
    if config.start != NOTHING:
        return start_of(config)
    kept = folder and folder / FOUND
    if kept and kept.exists():
        return Evolved(**read_json(kept))
    callback = _SearchCallback(on_search)
    evolve(place_of(config), {**physics_of(config), "threads": threads}, config.seed, callback)
    if kept:
        write_json(kept, asdict(callback.best))
    return callback.best


class _SearchCallback(EvaluationCallback[Evolved]):
    """Ends a search after `MOST` generations, and keeps the best policy."""

    def __init__(self, on_search: OnSearch | None) -> None:
        self._on_search, self._generations = on_search, 0

    def on_update(self, steps: int, policy: Callable[[], Evolved], returns: Sequence[float] = ()) -> bool:
        """Show the best policy every `SHOWN` generations; return whether to continue."""
        self.best = policy()
        if self._generations % SHOWN == 0:
            say(f"searching from nothing: {self._generations} generations")
            if self._on_search is not None:
                self._on_search(steps, self.best)
        self._generations += 1
        return self._generations <= MOST
