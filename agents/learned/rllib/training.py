"""Training a shared policy with RLlib, with the learning curve, checkpoints and best network of the native training."""

import os
import shutil
import time
from pathlib import Path

from crowd_env.core.console import say
from crowd_env.core.executors import RayCluster

from ...training_config import TrainingConfig, make_env
from ..callbacks import RunCallback, Trained
from ..training import trained_in
from .algorithm import begin_with, first_policy, make_algorithm, policy_of, set_rate

CHECKPOINT = "rllib"  # folder within that of the run
_LEARNER = 1  # cores that runners leave to the learner
_PATIENCE = 600.0  # s  without a step of any runner, after which the training fails


def train_on_cluster(folder: Path, config: TrainingConfig, runners: int | None = None, threads: int = 1) -> bool:
    """Train, or resume training, in ``folder`` on a Ray cluster; False if it was interrupted.

    The policy starts as the native one; RLlib draws the first critic at random.

    Parameters
    ----------
    runners : processes that simulate, one core each; by default all cores of the cluster but one, which learns.
    threads : of the evaluations, on this machine.

    Raises
    ------
    ValueError
        If the cluster cannot be reached, all of its runners have failed and none restarts, or RLlib lacks the distribution of
        the actions.
    """
    distribution = config.ppo.distribution
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
    """One part of a training, from its start or last checkpoint to the end of its budget or Ctrl-C."""

    def __init__(self, folder: Path, config: TrainingConfig, runners: int, threads: int) -> None:
        self.folder, self.config, self.threads = folder, config, threads
        self.callback = RunCallback(folder, config, self._write_checkpoint, threads)
        self.env, self.steps = make_env(config, envs=1), self.callback.steps
        say(f"{runners} runners simulate; compiling the physics takes half a minute of each node the first time")
        self.algorithm = make_algorithm(config, runners)
        self._alive = time.monotonic()  # when a runner last made a step

    def run(self) -> bool:
        """Train to the end of the budget; False if it was interrupted."""
        try:
            with self.callback.running():
                if self.callback.curve:
                    self.algorithm.restore_from_path(str((self.folder / CHECKPOINT).absolute()))
                    say(f"going on at {self.steps} steps")
                else:
                    first = first_policy(self.config, self.folder, self.threads)
                    begin_with(self.algorithm, first, self.config.ppo.log_std_init)
                returns: list[float] = []
                while self.callback.on_update(self.steps, self._policy, returns):
                    returns = self._iterate()
                self.callback.on_end(self.steps, self._policy)
        finally:
            self.algorithm.stop()
        return not self.callback.interrupted

    def _policy(self) -> Trained:
        return trained_in(self.env, policy_of(self.algorithm), self.config)

    def _iterate(self) -> list[float]:
        """Simulate on all runners, and learn; return the mean return of the episodes that ended, if any."""
        set_rate(self.algorithm, self.config.ppo.learning_rate * max(0.0, 1.0 - self.callback.progress))
        healthy = self.algorithm.env_runner_group.num_healthy_remote_workers()
        found = self.algorithm.train().get("env_runners", {})
        made = int(found.get("slot_steps", 0))
        if made > 0:
            self._alive = time.monotonic()
        elif time.monotonic() - self._alive > _PATIENCE:
            raise ValueError(f"no runner has made a step for {_PATIENCE:.0f} s; the last checkpoint is kept")
        self.steps += made
        self.callback.cpu_elsewhere += float(found.get("cpu_seconds", 0.0))
        now = self.algorithm.env_runner_group.num_healthy_remote_workers()
        if now < healthy:
            say(f"{healthy - now} of {healthy} workers failed; {now} remain while they restart")
        return [float(found["episode_return_mean"])] if "episode_return_mean" in found else []

    def _write_checkpoint(self, row: dict[str, float]) -> None:
        """Write a checkpoint of RLlib; it replaces the old one when it is whole."""
        path, new = (self.folder / f"{CHECKPOINT}{ending}" for ending in ("", ".new"))
        shutil.rmtree(new, ignore_errors=True)
        self.algorithm.save_to_path(str(new.absolute()))
        shutil.rmtree(path, ignore_errors=True)
        os.replace(new, path)
