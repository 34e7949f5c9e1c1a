"""Judge policies on the same draws: the same people in the same places, for every policy and scheme."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.policy import Policy
from crowd_env import CrowdEnv, EpisodeMetrics, Scenario, make_scenario
from crowd_env.metrics import summarise
from crowd_env.physics import ContactScheme, make_scheme

# Training draws from (seed, environment) with seeds below this; draws from here on have never been trained on.
HELD_OUT_SEED = 1_000_000
_BATCH = 50


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Many evacuations under one policy and scheme."""

    policy: str
    scheme: str
    episodes: list[EpisodeMetrics]
    exit_times: list[np.ndarray]  # (N,) s each, nan for those still inside

    @property
    def runs(self) -> int:
        """Number of evacuations."""
        return len(self.episodes)

    def column(self, name: str) -> np.ndarray:
        """Return one metric of every run (runs,)."""
        return np.array([getattr(episode, name) for episode in self.episodes], dtype=np.float64)

    def row(self) -> dict[str, Any]:
        """Return the figures as one JSON row; times in s, flow in 1/s, impulse in N s per person."""
        return {
            "policy": self.policy,
            "scheme": self.scheme,
            "runs": self.runs,
            "unfinished": int(self.column("unfinished").sum()),
            "evacuation_time": _named(self.column("evacuation_time")),
            "mean_exit_time": _named(self.column("mean_exit_time")),
            "flow": _named(self.column("flow")),
            "contact_impulse": _named(self.column("contact_impulse")),
        }


def _named(values: np.ndarray) -> dict[str, Any]:
    summary = summarise(values)
    return {
        "mean": _number(summary.mean),
        "sd": _number(summary.sd),
        "ci95": [_number(bound) for bound in summary.ci95],
    }


def _number(value: float) -> float | None:
    """JSON knows no nan."""
    return None if np.isnan(value) else value


def evaluate(
    policy: Policy,
    scenario: str | Scenario = "room-v0",
    *,
    scheme: str | ContactScheme = "nsm2",
    runs: int = 50,
    first_seed: int = HELD_OUT_SEED,
    progress: Callable[[int], None] | None = None,
    **options: Any,
) -> Evaluation:
    """Run ``runs`` evacuations, draw ``first_seed + k`` for run ``k``.

    Parameters
    ----------
    progress : called with the number of runs that have just finished.
    options : further options of `CrowdEnv`; those the policy was trained with come first.
    """
    if runs < 1:
        raise ValueError(f"runs is {runs}; it must be at least 1")
    episodes: list[EpisodeMetrics] = []
    exit_times: list[np.ndarray] = []
    scenario = make_scenario(scenario)
    for begin in range(0, runs, _BATCH):
        seeds = [first_seed + k for k in range(begin, min(begin + _BATCH, runs))]
        env = CrowdEnv(scenario, num_envs=len(seeds), scheme=scheme, **{**options, **policy.env_options})
        observation, _ = env.reset(seeds)
        policy.reset(np.ones(len(seeds), dtype=np.bool_))
        rng = np.random.default_rng(first_seed + begin)
        while not env.finished.all():
            step = env.step(policy.act(observation, env.layout, rng))
            observation = step.observation
            if progress is not None and step.info["finished"].any():
                progress(int(step.info["finished"].sum()))
        for e in range(len(seeds)):
            episodes.append(env.metrics(e))
            exit_times.append(env.simulation.state.exit_time[env.people(e)].copy())
    return Evaluation(policy.name, make_scheme(scheme).info.name, episodes, exit_times)
