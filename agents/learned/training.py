"""A training run: the network of a config learns by stable-baselines3's PPO; its curve, its checkpoints, a clean stop.

Policies of people's own steps and controllers that send people to exits are trained alike.
"""

import csv
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, cast

import gymnasium
import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure

from crowd_env import CrowdEnv, GeneratedCrowds
from crowd_env.core.console import notes, say, stops_by
from crowd_env.core.files.csv_table import write_csv
from crowd_env.envs.action import SpeedTable, make_action
from crowd_env.envs.routing.env import RoutingVectorEnv

from ..evaluation.comparison import last_times
from ..evaluation.evaluation import HELD_OUT_SEED, VALIDATION_SEED, Evaluation, evaluate
from ..evaluation.plans import judge_plan
from ..networks import MLP, NETWORK, BetweenMLP, Network
from ..policy import Policy
from ..trained import LearnedController, LearnedPolicy
from ..training_config import facts_of, judged_place, make_env, physics_of, task_of
from .checkpoint import read_checkpoint, write_checkpoint
from .cloning import begin
from .export import network_of, spread_of
from .ppo import PPOSettings, make_ppo
from .rate import FallingRate

START = "start.safetensors"  # the network that training began with
CURVE = "learning_curve.csv"
SEARCH = "search_curve.csv"  # of a search that came before, in the same columns
MARGIN = 0.5  # s: who is less than this later is as soon

# evacuation_time and its standard error are over all validation draws, people left inside count as in
# `Evaluation.times_of_all`; reward is the mean return of the episodes that ended since the row before.
CURVE_COLUMNS = (
    *("steps", "seconds", "cpu_seconds", "evacuation_time", "standard_error"),
    *("unfinished", "contact_impulse", "reward", "episodes"),
)


class Keeper:
    """Judges the network of a training on validation draws; keeps its curve, its start and the best, if selfish the last.

    Parameters
    ----------
    config : of the run; ``threads`` are those of the evaluations.

    Attributes
    ----------
    curve : a row for each evaluation, of earlier parts of the run too.
    """

    def __init__(self, folder: Path, config: Mapping[str, Any], threads: int = 1) -> None:
        self.folder, self.config = folder, config
        self.curve = read_curve(folder / CURVE)
        before = self.curve[-1] if self.curve else {"seconds": 0.0, "cpu_seconds": 0.0}
        self._begin = time.monotonic() - before["seconds"], time.process_time() - before["cpu_seconds"]
        task = task_of(config)
        self._judged = {**physics_of(config), "learned_share": task.learned_share, "threads": threads}
        self._keeps_last = task.selfish
        self.returns: list[float] = []  # of the episodes that have ended since the last row
        self._searched: list[dict[str, float]] = []

    @property
    def seconds(self) -> float:
        """Training time so far [s], earlier parts of the run included."""
        return time.monotonic() - self._begin[0]

    @property
    def cpu_seconds(self) -> float:
        """CPU time of this process so far [s], of all threads and of earlier parts of the run."""
        return time.process_time() - self._begin[1]

    def share(self, steps: float) -> float:
        """Return the share of the budget that is spent: of steps or of time, whichever is further."""
        return max(steps / self.config["steps"], self.seconds / (60.0 * self.config["minutes"]))

    @property
    def late(self) -> float:
        """Share of the second half of the time that has passed.

        Training that needs less than half of it depends on its seed alone, and not on what else the machine does.
        """
        return max(0.0, 2.0 * self.share(0.0) - 1.0)

    def saw(self, steps: int, policy: Policy) -> None:
        """Judge the best of a search so far, and write its curve; ``steps`` are decisions of people inside."""
        self._searched.append(self._row(policy, steps))
        write_curve(self.folder / SEARCH, self._searched)

    def _row(self, who: Policy | LearnedController, steps: float, cpu: float = 0.0) -> dict[str, float]:
        spent = {"steps": steps, "seconds": self.seconds, "cpu_seconds": self.cpu_seconds + cpu}
        place, runs = judged_place(self.config), self.config["eval_runs"]
        result = evaluate(who, place, runs=runs, first_seed=VALIDATION_SEED, **self._judged)
        return curve_row(result, spent, self.returns)

    def judge(
        self, who: LearnedPolicy | LearnedController, steps: float, checkpoint: Callable[[], None], *, cpu: float = 0.0
    ) -> dict[str, float]:
        """Judge what has been learned and return its row of the curve.

        Parameters
        ----------
        checkpoint : writes from where training goes on, before the curve says that it can.
        cpu : s, spent in other processes.
        """
        row = self._row(who, steps, cpu)
        self.returns.clear()
        self.curve.append(row)
        checkpoint()
        if len(self.curve) == 1:
            who.save(self.folder / START)
        if best_row(self.curve) is row or self._keeps_last:
            who.save(self.folder / NETWORK)
        write_curve(self.folder / CURVE, self.curve)
        if not notes.is_terminal:  # says in a line what a bar would show
            say(
                f"{row['steps']:.0f} of {self.config['steps']} steps, {row['seconds']:.0f} s: evacuation "
                f"{row['evacuation_time']:.2f} ± {row['standard_error']:.2f} (standard error) s, "
                f"{row['unfinished']:.0f} left inside"
            )
        return row


class PlanKeeper(Keeper):
    """A `Keeper` of a training in all places: it judges in generated ones, of seeds that training never draws.

    In its curve ``unfinished`` counts plans in which somebody was left or strayed, and ``evacuation_time`` is the interquartile
    mean over plans, with the standard error of a mean of the middle half.
    """

    def _row(self, who: Policy | LearnedController, steps: float, cpu: float = 0.0) -> dict[str, float]:
        seeds = range(VALIDATION_SEED, VALIDATION_SEED + self.config["eval_runs"])
        found = [judge_plan(cast(Policy, who), seed) for seed in seeds]
        missing = np.array([one.left + one.strayed for one in found])
        times = np.sort(np.where(missing > 0.0, np.inf, [one.time for one in found]))
        middle = times[len(times) // 4 : len(times) - len(times) // 4]
        spread = middle.std(ddof=1) if np.isfinite(middle).all() else np.inf
        return {
            "steps": float(steps),
            "seconds": self.seconds,
            "cpu_seconds": self.cpu_seconds + cpu,
            "evacuation_time": float(middle.mean()),
            "standard_error": float(spread / np.sqrt(len(middle))),
            "unfinished": float((missing > 0.0).sum()),
            "contact_impulse": float(np.mean([one.impulse for one in found])),
            "reward": float(np.mean(self.returns)) if self.returns else np.nan,
            "episodes": float(len(self.returns)),
        }


def keeper_of(folder: Path, config: Mapping[str, Any], threads: int = 1) -> Keeper:
    """Return what judges a training: in its own place, or in generated ones."""
    return (Keeper if config["places"] is None else PlanKeeper)(folder, config, threads)


def trained_in(
    env: CrowdEnv | GeneratedCrowds | RoutingVectorEnv,
    network: Network,
    config: Mapping[str, Any],
    spread: list[float] | None = None,
) -> LearnedPolicy | LearnedController:
    """Return the policy or controller that a network is, after training in ``env``; of all places, it acts between speeds."""
    facts = facts_of(config)
    if isinstance(env, CrowdEnv | GeneratedCrowds):
        table = env.action_kind.decode
        if isinstance(env, GeneratedCrowds) and isinstance(network, MLP) and type(table) is SpeedTable:
            network = BetweenMLP(network.weights, network.biases, network.activation, table)
            return LearnedPolicy(network, {**env_options_of(env), "action": make_action("continuous")}, facts)
        return LearnedPolicy(network, env_options_of(env), facts, spread)
    return LearnedController(network, env.batch.choices, config["routing"], facts)


def env_options_of(env: CrowdEnv | GeneratedCrowds) -> dict[str, Any]:
    """Return what a policy trained in ``env`` must know of it."""
    return {"frame": env.action_kind.frame, "action": env.action_kind, "observation": env.layout}


class TrainingCallback(BaseCallback):
    """Accompanies a training: a bar, an evaluation with a checkpoint now and then, and a stop in time.

    It stops when the time is over, or at the first Ctrl-C or SIGTERM; a second one stops at once.
    """

    def __init__(self, keeper: Keeper, env: CrowdEnv | GeneratedCrowds | RoutingVectorEnv) -> None:
        super().__init__()
        self.keeper, self.env = keeper, env
        self.interrupted = False
        self._due = 0  # steps of the next evaluation; set when training starts
        self._signals = ExitStack()
        self._bar = Progress(  # on the error stream: the table goes to standard output
            TextColumn("training"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[figures]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=notes,
        )

    def close(self) -> None:
        """Take the bar away and handle signals as before; also after an error."""
        self._bar.stop()
        self._signals.close()

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        say("stopping: saving what there is (Ctrl-C again stops at once)")

    def _on_training_start(self) -> None:
        self._signals.enter_context(stops_by(self._interrupt))
        self._first = time.monotonic(), self.num_timesteps
        self._due = self.num_timesteps + self.keeper.config["eval_every"]
        self._task = self._bar.add_task("", total=1.0, figures="")
        self._bar.start()
        if not self.keeper.curve:
            self._evaluate()

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        self.keeper.returns += [infos[row]["episode"]["r"] for row in np.flatnonzero(self.locals["dones"])]
        return self.keeper.seconds <= 60.0 * self.keeper.config["minutes"] and not self.interrupted

    def _on_rollout_end(self) -> None:
        for name, value in saturation(cast(Any, self.model).rollout_buffer, self.model.action_space).items():
            self.logger.record(f"rollout/{name}", value)
        cast(FallingRate, self.model.learning_rate).time_spent = self.keeper.late
        rate = (self.num_timesteps - self._first[1]) / max(time.monotonic() - self._first[0], 1e-9)
        best = min((row["evacuation_time"] for row in self.keeper.curve if row["unfinished"] == 0), default=np.nan)
        done = min(self.keeper.share(self.num_timesteps), 1.0)
        self._bar.update(self._task, completed=done, figures=f"{rate:.0f} steps/s, best {best:.2f} s")
        if self._due <= self.num_timesteps < self.model._total_timesteps:  # the end is evaluated anyway
            self._evaluate()
            self._due = self.num_timesteps + self.keeper.config["eval_every"]

    def _on_training_end(self) -> None:
        self._evaluate()
        self.close()

    def _evaluate(self) -> None:
        who = trained_in(self.env, network_of(self.model), self.keeper.config, spread_of(self.model))
        path = self.keeper.folder / "checkpoint.pt"
        row = self.keeper.judge(who, self.num_timesteps, partial(write_checkpoint, path, self.model))
        for name, value in row.items():
            self.logger.record(f"eval/{name}", value)
        self.logger.dump(self.num_timesteps)


def train_here(folder: Path, config: dict[str, Any], threads: int = 1) -> bool:
    """Train, or go on training, in ``folder`` on so many threads of this machine; False if it was interrupted."""
    say("compiling the physics (half a minute the first time, cached afterwards) ...")
    env = make_env(config, threads=threads)
    model = make_ppo(env, PPOSettings(**config["ppo"]), config["seed"], folder / "tensorboard")
    keeper = keeper_of(folder, config, threads)
    if keeper.curve:
        read_checkpoint(folder / "checkpoint.pt", model)
        # The learning loop resets the environment with the seed of the VecEnv.
        venv: Any = model.get_env()
        venv.seed((config["seed"] + model.num_timesteps) % HELD_OUT_SEED)  # other draws
        say(f"going on at {model.num_timesteps} steps")
    else:
        begin(model, config, folder, threads, keeper.saw)
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    callback = TrainingCallback(keeper, env)
    left = config["steps"] - model.num_timesteps
    if left > 0 and (not keeper.curve or keeper.curve[-1]["seconds"] < 60.0 * config["minutes"]):
        try:
            model.learn(left, callback=callback, reset_num_timesteps=False)
        finally:
            callback.close()
    return not callback.interrupted


def saturation(buffer: Any, space: gymnasium.Space[Any]) -> dict[str, float]:
    """Return how far a Gaussian policy runs into the bounds of its actions; nothing of other spaces than a Box.

    A mean beyond the bound says that the policy explores nothing on the other side of it any more.

    Parameters
    ----------
    buffer : a full rollout; of one with a ``mask`` the masked samples alone.

    Returns
    -------
    ``clipped_share``, of the actions of which a component lay beyond its bounds, and ``raw_action_<k>``, the mean of each
    component as it was drawn, before it was clipped.
    """
    if not isinstance(space, gymnasium.spaces.Box):
        return {}
    drawn = buffer.actions.reshape(*buffer.actions.shape[:2], -1)
    drawn = drawn[getattr(buffer, "mask", np.ones(drawn.shape[:2], dtype=np.bool_))]
    beyond = (drawn < space.low.ravel()) | (drawn > space.high.ravel())
    means = {f"raw_action_{k}": float(value) for k, value in enumerate(drawn.mean(axis=0))}
    return {"clipped_share": float(beyond.any(axis=1).mean()), **means}


def curve_row(result: Evaluation, spent: Mapping[str, float], returns: Sequence[float]) -> dict[str, float]:
    """Return the row of a learning curve: an evaluation, what was spent by then, and returns of episodes since."""
    times = last_times(result)
    values = {
        **spent,
        "evacuation_time": times.mean(),
        "standard_error": times.std(ddof=1) / np.sqrt(len(times)) if len(times) > 1 else np.nan,
        "unfinished": result.column("unfinished").sum(),
        "contact_impulse": result.column("contact_impulse").mean(),
        "reward": np.mean(returns) if len(returns) else np.nan,
        "episodes": len(returns),
    }
    return {name: float(values[name]) for name in CURVE_COLUMNS}


def score(row: Mapping[str, float]) -> tuple[float, float]:
    """Fewer people left behind first, then sooner out."""
    return row["unfinished"], row["evacuation_time"]


def best_row(curve: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the row of the network that did best: of those less than `MARGIN` later than the soonest so far the softest."""
    best, soonest = curve[0], score(curve[0])

    def near(row: Mapping[str, float]) -> bool:
        return row["unfinished"] == soonest[0] and row["evacuation_time"] <= soonest[1] + MARGIN

    for row in curve[1:]:
        soonest = min(soonest, score(row))
        if near(row) and (not near(best) or row["contact_impulse"] < best["contact_impulse"]):
            best = row
    return best


def write_curve(path: Path, curve: Sequence[Mapping[str, float]]) -> None:
    """Write a learning curve as CSV, whole or not at all."""
    write_csv(path, CURVE_COLUMNS, ([row[name] for name in CURVE_COLUMNS] for row in curve))


def read_curve(path: Path) -> list[dict[str, float]]:
    """Read what `write_curve` wrote; no file is an empty curve.

    Raises
    ------
    ValueError
        If the file has other columns, or something in it is no number.
    """
    if not path.exists():
        return []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        if not rows or tuple(rows[0]) != CURVE_COLUMNS:
            raise ValueError(f"its columns must be {', '.join(CURVE_COLUMNS)}")
        return [{name: float(row[name]) for name in CURVE_COLUMNS} for row in rows]
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise ValueError(f"cannot go on from {path}: {error}") from None
