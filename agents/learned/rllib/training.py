"""Training a shared policy with RLlib: learning curve, checkpoints and the best network, as the native training leaves them."""

import os
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from crowd_env.core.console import notes, progress_bar, stops_by
from crowd_env.core.executors import RayCluster

from ...evaluation.entries import RULE
from ...evaluation.evaluation import VALIDATION_SEED, evaluate
from ...networks import NETWORK
from ...trained import LearnedPolicy
from ...training_config import facts_of, judged_place, make_env, physics_of
from ..rate import FallingRate
from ..training import START, curve_line, curve_row, env_options_of, read_curve, score, write_curve

CHECKPOINT = "rllib"  # folder below that of the run
_LEARNER = 1  # cores that runners leave to the learner
_PARTS = 1000  # of the progress bar
_PATIENCE = 600.0  # s  without a step of any runner, until the training is given up


def train_on_cluster(folder: Path, config: Mapping[str, Any], runners: int | None = None, threads: int = 1) -> bool:
    """Train, or go on training, in ``folder`` on a Ray cluster; False if it was interrupted.

    The policy starts as the native one does; what RLlib begins at random are the values.

    Parameters
    ----------
    runners : processes that simulate, a core each; by default as many as the cluster has cores, less one that learns.
    threads : of the evaluations in between, here.

    Raises
    ------
    ValueError
        If the cluster cannot be reached, all of its runners have died and none can be begun again, or actions are to follow
        a distribution that RLlib lacks.
    """
    distribution = config["ppo"]["distribution"]
    if distribution != "gaussian":
        raise ValueError(
            f"--backend rllib knows continuous actions of a Gaussian, not of the distribution {distribution}"
        )
    cluster = RayCluster()
    try:
        return _Training(folder, config, runners or max(cluster.workers - _LEARNER, 1), threads).run()
    finally:
        cluster.close()


class _Training:
    """One part of a training, from its start or last checkpoint to the end of its budget, or Ctrl-C."""

    def __init__(self, folder: Path, config: Mapping[str, Any], runners: int, threads: int) -> None:
        from .algorithm import make_algorithm

        self.folder, self.config, self.interrupted = folder, config, False
        self.judged = {**physics_of(config), "threads": threads}
        self.options = env_options_of(make_env(config, envs=1))
        self.curve = read_curve(folder / "learning_curve.csv")
        notes.print(
            f"{runners} runners simulate; compiling the physics takes half a minute of each node the first time"
        )
        self.algorithm = make_algorithm(config, runners)
        self.rate = FallingRate(config["ppo"]["learning_rate"])
        self.steps = 0.0
        self._returns: list[float] = []
        before = self.curve[-1] if self.curve else {"seconds": 0.0, "cpu_seconds": 0.0}
        self._begin = time.monotonic() - before["seconds"], time.process_time() - before["cpu_seconds"]
        self._cpu_far = 0.0
        self._alive = time.monotonic()  # when a runner last made a step

    @property
    def spent(self) -> dict[str, float]:
        """Steps of all pedestrian slots, time, and processor time of learner and runners [s]."""
        here = time.process_time() - self._begin[1]
        return {"steps": self.steps, "seconds": time.monotonic() - self._begin[0], "cpu_seconds": here + self._cpu_far}

    @property
    def share(self) -> float:
        """Share of the budget that is spent: of steps or of time, whichever is further."""
        return max(self.steps / self.config["steps"], self.spent["seconds"] / (60.0 * self.config["minutes"]))

    def run(self) -> bool:
        """Train to the end of the budget; False if it was interrupted."""
        try:
            with stops_by(self._interrupt), progress_bar("training", _PARTS) as progress:
                if self.curve:
                    self.algorithm.restore_from_path(str((self.folder / CHECKPOINT).absolute()))
                    self.steps = self.curve[-1]["steps"]
                    notes.print(f"going on at {self.steps:.0f} steps")
                else:
                    self._start()
                    self._evaluate()
                due, shown = self.steps + self.config["eval_every"], 0
                while self.share < 1.0 and not self.interrupted:
                    self._iterate()
                    progress(round(_PARTS * min(self.share, 1.0)) - shown)
                    shown = round(_PARTS * min(self.share, 1.0))
                    if self.steps >= due and self.share < 1.0:
                        self._evaluate()
                        due += self.config["eval_every"]
                self._evaluate()
        finally:
            self.algorithm.stop()
        return not self.interrupted

    def _start(self) -> None:
        """Begin as the native training would."""
        from .algorithm import begin_with
        from .module import first_policy

        if self.config["start"] != RULE:
            notes.print(f"cloning {self.config['start']}, a fraction of a minute ...")
        begin_with(self.algorithm, first_policy(self.config), self.config["ppo"]["log_std_init"])

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        notes.print("stopping: saving what there is (Ctrl-C again stops at once)")

    def _iterate(self) -> None:
        """Let all runners simulate, and learn from it."""
        from .algorithm import set_rate

        self.rate.time_spent = min(self.share, 1.0)
        set_rate(self.algorithm, self.rate(1.0 - min(self.steps / self.config["steps"], 1.0)))
        healthy = self.algorithm.env_runner_group.num_healthy_remote_workers()
        result = self.algorithm.train()
        found = result.get("env_runners", {})
        made = float(found.get("slot_steps", 0.0))
        if made > 0.0:
            self._alive = time.monotonic()
        elif time.monotonic() - self._alive > _PATIENCE:
            raise ValueError(f"no runner has made a step for {_PATIENCE:.0f} s; the last checkpoint is kept")
        self.steps += made
        self._cpu_far += float(found.get("cpu_seconds", 0.0))
        self._returns += [float(found["episode_return_mean"])] if "episode_return_mean" in found else []
        now = self.algorithm.env_runner_group.num_healthy_remote_workers()
        if now < healthy:
            notes.print(f"a runner has died: {now} go on until it is begun again")

    def _evaluate(self) -> None:
        """Evaluate the network as it is on validation draws, write curve and checkpoint, and keep it if it is the best."""
        from .algorithm import policy_of

        policy = LearnedPolicy(policy_of(self.algorithm), self.options, facts_of(self.config))
        place, runs = judged_place(self.config), self.config["eval_runs"]
        result = evaluate(policy, place, runs=runs, first_seed=VALIDATION_SEED, **self.judged)
        row = curve_row(result, self.spent, self._returns)
        self._returns.clear()
        best_before = min(map(score, self.curve), default=(np.inf, np.inf))
        self.curve.append(row)
        self._write_checkpoint()
        if len(self.curve) == 1:
            policy.save(self.folder / START)
        if score(row) < best_before:
            policy.save(self.folder / NETWORK)
        write_curve(self.folder / "learning_curve.csv", self.curve)
        if not notes.is_terminal:
            notes.print(curve_line(row, self.config["steps"]))

    def _write_checkpoint(self) -> None:
        """Write what RLlib needs to go on; a new checkpoint takes the place of the old one when it is whole."""
        path, new = (self.folder / f"{CHECKPOINT}{ending}" for ending in ("", ".new"))
        shutil.rmtree(new, ignore_errors=True)
        self.algorithm.save_to_path(str(new.absolute()))
        shutil.rmtree(path, ignore_errors=True)
        os.replace(new, path)
