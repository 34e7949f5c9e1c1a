"""A significance test: is the best network of a training better than its first, on fresh draws?

The best network of a learning curve is partly lucky: it is the best of many evaluations on few validation draws.  Where
training starts at a rule that is hard to beat, the lucky network can be worse than the rule.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.console import say
from crowd_env.core.files.atomic import write_bytes
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.tasks.task import HELD_OUT_SEED

from ..evaluation.comparison import last_times
from ..evaluation.entries import make_entries
from ..evaluation.evaluation import FINAL_SEED
from ..evaluation.folder import EvaluationFolder, settings_of
from ..evaluation.same_draws import compare
from ..networks import NETWORK
from ..training_config import TrainingConfig, judged_place, law_of, task_of
from .callbacks import START
from .curve import CURVE, MARGIN, best_row, read_curve, standard_error

UNCONFIRMED, FOUND = "unconfirmed.safetensors", "confirmation.json"
LOOKS, DRAWS = 4, 25  # largest number of looks, and further draws of each
# Group-sequential test of O'Brien and Fleming (1979) at 5 %, two-sided, four looks: after look k the difference over its
# standard error must exceed 2.024 √(4 / k) (Jennison and Turnbull 2000, table 2.3).
_BOUND = 2.024
_BLOCKS = 60_000  # of draws; each training has one block, and all blocks end below the draws of submissions


def compare_with_start(folder: Path, config: TrainingConfig, threads: int = 1) -> None:
    """Keep the first network of a finished training on a task unless the best on validation draws is significantly better.

    Both networks move the crowd of the task, with its number of pedestrians and physics step, on the same fresh draws.  These
    draws belong to this task and seed alone (`first_draw`).  The test compares times of the last pedestrian; a pedestrian left
    inside counts until the time limit.  A network that is sooner ends the test early, and one that is less than `MARGIN` later
    and has less contact: the test keeps both.  So does one that is more than `MARGIN` later: the test keeps the start.  The
    test also keeps a network that has less contact and is not later on average, if all draws leave the time undecided.

    Type-I error: 2.5 % for a network that is no sooner, and 2.5 % for one that is `MARGIN` later.  Both are tested against the
    same bounds at each look.  Contact is a further hypothesis on the same draws at every look.  It has the bound of a single
    look, with an error below 0.1 %.

    ``confirmation.json`` holds the result.  Simulated draws are kept, so that an interrupted test can continue.  If the test
    keeps the start, ``best.safetensors`` is the start, and ``unconfirmed.safetensors`` the other network.

    There is no test of a run whose start did best, or that an earlier version began; a selfish task keeps the last network.
    """
    if task_of(config).selfish:
        write_json(folder / FOUND, {"kept": "last"})
        return
    curve = read_curve(folder / CURVE)
    best = best_row(curve)
    _reopen(folder, best)
    if best is curve[0] or not (folder / START).exists():
        return
    say("confirming the network on fresh draws, beside the one training began with ...")
    later, harder = np.empty(0), np.empty(0)
    for look in range(LOOKS):
        time, impulse = _minus_start(folder, config, look, threads)
        later, harder = np.append(later, time), np.append(harder, impulse)
        z, bound = _over_error(later), _BOUND * np.sqrt(LOOKS / (look + 1))
        sooner, softer = z < -bound, _over_error(harder) < -_BOUND * np.sqrt(LOOKS)
        beyond_margin = _over_error(later - MARGIN)
        as_soon = beyond_margin < -bound
        if sooner or (softer and as_soon) or beyond_margin > bound:
            break
    mean = float(later.mean())
    kept = sooner or (softer and (as_soon or (mean <= 0.0 and z <= bound)))
    found = {
        "kept": "trained" if kept else "start",
        "steps": best["steps"],
        "draws": len(later),
        "seconds_later": mean,
        "standard_error": standard_error(later),
        "bound": float(bound),
        "impulse_more": float(harder.mean()),
        "impulse_standard_error": standard_error(harder),
    }
    write_json(folder / FOUND, found)
    text = f"the network of step {best['steps']:.0f} is {abs(mean):.2f} s {'sooner' if mean < 0.0 else 'later'} out than the "
    text += f"start on {len(later)} fresh draws"
    if kept:
        say(f"{text}{'' if sooner else f', and touches less, by {-harder.mean():.0f} N s a person'}: kept")
        return
    write_bytes(folder / UNCONFIRMED, (folder / NETWORK).read_bytes())
    write_bytes(folder / NETWORK, (folder / START).read_bytes())
    say(f"{text}, not better beyond doubt: the start is kept")


def kept_row(folder: Path, curve: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the row of the learning curve for the kept network."""
    kept = (outcome(folder) or {}).get("kept")
    if kept in ("start", "last"):
        return curve[0 if kept == "start" else -1]
    return best_row(curve)


def outcome(folder: Path) -> dict[str, str | float] | None:
    """Return the result of `compare_with_start`; None without a test."""
    return read_json(folder / FOUND) if (folder / FOUND).exists() else None


def _reopen(folder: Path, best: dict[str, float]) -> None:
    """Delete an earlier result; a network that it rejected is tested again if it still is the best of the curve."""
    before, refused = outcome(folder), folder / UNCONFIRMED
    if before is not None and refused.exists() and before["steps"] == best["steps"]:
        write_bytes(folder / NETWORK, refused.read_bytes())
    (folder / FOUND).unlink(missing_ok=True)
    refused.unlink(missing_ok=True)


def _minus_start(folder: Path, config: TrainingConfig, look: int, threads: int) -> tuple[Floats, Floats]:
    """Return network minus start in each draw of a look: time of the last pedestrian [s], impulse [N s]."""
    place, task = judged_place(config), task_of(config)
    seed = first_draw(config) - HELD_OUT_SEED + look * DRAWS
    kept = EvaluationFolder(folder / f"confirmation-{look + 1}", settings_of(place, DRAWS, seed, task))
    entries = make_entries([str(folder / name) for name in (START, NETWORK)], place, task)
    start, best = compare(entries, place, [law_of(config)], runs=DRAWS, seed=seed, threads=threads, folder=kept)
    impulse = best.column("contact_impulse") - start.column("contact_impulse")
    return last_times(best) - last_times(start), impulse


def first_draw(config: TrainingConfig) -> int:
    """Return the seed of the first draw, which follows from task or scenario and the seed of the training."""
    number = int(fingerprint(config.task or config.scenario, config.seed), 16)
    return FINAL_SEED + LOOKS * DRAWS * (number % _BLOCKS)


def _over_error(difference: Floats) -> float:
    """Return the mean over its standard error; infinite for equal differences other than 0."""
    mean, error = float(difference.mean()), standard_error(difference)
    return mean / error if error > 0.0 else float(np.sign(mean)) * np.inf if mean else 0.0
