"""Training a shared policy with RLlib: learning curve, checkpoints and the best network, as the native training leaves them."""

import os
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import Any

from crowd_env.core.console import progress_bar, say, stops_by
from crowd_env.core.executors import RayCluster

from ...training_config import make_env
from ..rate import FallingRate
from ..training import keeper_of, trained_in
from .algorithm import begin_with, make_algorithm, policy_of, set_rate
from .module import first_policy

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
        self.folder, self.config, self.threads, self.interrupted = folder, config, threads, False
        self.keeper, self.env = keeper_of(folder, config, threads), make_env(config, envs=1)
        say(f"{runners} runners simulate; compiling the physics takes half a minute of each node the first time")
        self.algorithm = make_algorithm(config, runners)
        self.rate = FallingRate(config["ppo"]["learning_rate"])
        self.steps = 0.0
        self._cpu_far = 0.0
        self._alive = time.monotonic()  # when a runner last made a step

    @property
    def share(self) -> float:
        """Share of the budget that is spent."""
        return self.keeper.share(self.steps)

    def run(self) -> bool:
        """Train to the end of the budget; False if it was interrupted."""
        try:
            with stops_by(self._interrupt), progress_bar("training", _PARTS) as progress:
                if self.keeper.curve:
                    self.algorithm.restore_from_path(str((self.folder / CHECKPOINT).absolute()))
                    self.steps = self.keeper.curve[-1]["steps"]
                    say(f"going on at {self.steps:.0f} steps")
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
        first = first_policy(self.config, self.folder, self.threads)
        begin_with(self.algorithm, first, self.config["ppo"]["log_std_init"])

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        say("stopping: saving what there is (Ctrl-C again stops at once)")

    def _iterate(self) -> None:
        """Let all runners simulate, and learn from it."""
        self.rate.time_spent = self.keeper.late
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
        self.keeper.returns += [float(found["episode_return_mean"])] if "episode_return_mean" in found else []
        now = self.algorithm.env_runner_group.num_healthy_remote_workers()
        if now < healthy:
            say(f"a runner has died: {now} go on until it is begun again")

    def _evaluate(self) -> None:
        """Evaluate the network as it is on validation draws, write curve and checkpoint, and keep it if it is the best."""
        who = trained_in(self.env, policy_of(self.algorithm), self.config)
        self.keeper.judge(who, self.steps, self._write_checkpoint, cpu=self._cpu_far)

    def _write_checkpoint(self) -> None:
        """Write what RLlib needs to go on; a new checkpoint takes the place of the old one when it is whole."""
        path, new = (self.folder / f"{CHECKPOINT}{ending}" for ending in ("", ".new"))
        shutil.rmtree(new, ignore_errors=True)
        self.algorithm.save_to_path(str(new.absolute()))
        shutil.rmtree(path, ignore_errors=True)
        os.replace(new, path)
