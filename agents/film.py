"""Record an evacuation under a policy, to be drawn."""

from typing import Any

import numpy as np

from agents.evaluation.evaluation import HELD_OUT_SEED
from agents.policy import Policy
from crowd_env import CrowdEnv, Scenario
from crowd_env.physics import ContactScheme
from crowd_env.rendering import Recording
from crowd_env.rendering.live import Recorder


def record(
    policy: Policy,
    scenario: str | Scenario = "room-v0",
    *,
    scheme: str | ContactScheme = "nsm2",
    seed: int = HELD_OUT_SEED,
    title: str = "",
    **options: Any,
) -> Recording:
    """Return one evacuation under ``policy``, a snapshot a decision step."""
    env = CrowdEnv(scenario, scheme=scheme, **{**options, **policy.env_options})
    observation, _ = env.reset([seed])
    policy.reset(np.ones(1, dtype=np.bool_))
    rng = np.random.default_rng(seed)
    recorder = Recorder(env)
    recorder.snap()
    while not env.finished.all():
        observation = env.step(policy.act(observation, env.layout, rng)).observation
        recorder.snap()
    return recorder.recording(title or policy.name)
