"""crowd_env: reinforcement learning in crowds that really touch each other.

Pedestrians leave buildings under granular contact physics, as PettingZoo, Gymnasium and plain-array environments.
"""

from importlib import import_module
from typing import Any

import gymnasium
import pettingzoo

from crowd_env.core.arrays.state import Bodies, CrowdState, make_bodies, make_state
from crowd_env.core.behaviors.balance import BALANCES, Balance
from crowd_env.core.behaviors.headway import MANNERS, Headway
from crowd_env.core.behaviors.outline import OUTLINES, Disc, Outline
from crowd_env.core.behaviors.pulls import Attraction, GroupCohesion, Pulls
from crowd_env.core.version import __version__ as __version__
from crowd_env.envs.action import ActionKind
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.generated import GeneratedCrowds
from crowd_env.envs.gymnasium_env import CrowdGymEnv, CrowdVectorEnv, make_vec
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.observation.layout import ObservationLayout, ObservationTerm
from crowd_env.envs.parallel import CrowdParallelEnv, parallel_env
from crowd_env.envs.reward import RewardWeights
from crowd_env.envs.rollout import rollout
from crowd_env.envs.settings import Routing
from crowd_env.envs.tasks.task import TASKS, make_task
from crowd_env.envs.terms import RewardTerm
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import DEM, NSM1, NSM2, SCHEMES, SOCIAL_FORCES, Helbing, Hertz, SocialForce, make_scheme
from crowd_env.physics.pressure import contact_pressure, crowd_pressure
from crowd_env.physics.settings import Physics, Walking
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.recording import Recording, record
from crowd_env.routing.fields.field import OneWay
from crowd_env.routing.spec import ControlRule, DoorEvent, Gate, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.scenarios import SCENARIOS, make_scenario
from crowd_env.scenarios.arrivals import Arrivals
from crowd_env.scenarios.cohorts import Cohorts
from crowd_env.scenarios.population import TABLE_4, LogNormal, Normal, Population, Uniform
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario
from crowd_env.scenarios.sections import Section
from crowd_env.scenarios.starts import read_starts

# What one controller decides for all: name -> how Gymnasium makes the environment.
_CONTROLLED: dict[str, dict[str, Any]] = {
    "crowd_env/routing-v0": {
        "entry_point": "crowd_env.envs.routing.env:RoutingEnv",
        "vector_entry_point": "crowd_env.envs.routing.env:RoutingVectorEnv",
    },
    "crowd_env/footbridge-gate-v0": {"entry_point": "crowd_env.envs.footbridge.env:FootbridgeEnv"},
}

__all__ = [
    "BALANCES",
    "DEM",
    "FULL_SPEED",
    "MANNERS",
    "NSM1",
    "NSM2",
    "OUTLINES",
    "SCENARIOS",
    "SCHEMES",
    "SOCIAL_FORCES",
    "TABLE_4",
    "TASKS",
    "ActionKind",
    "Arrivals",
    "Attraction",
    "Balance",
    "Bodies",
    "Cohorts",
    "Comfort",
    "ControlRule",
    "CrowdEnv",
    "CrowdGymEnv",
    "CrowdParallelEnv",
    "CrowdState",
    "CrowdVectorEnv",
    "Disc",
    "DoorEvent",
    "EpisodeMetrics",
    "Gate",
    "GeneratedCrowds",
    "Geometry",
    "GroupCohesion",
    "Headway",
    "Helbing",
    "Hertz",
    "LogNormal",
    "Normal",
    "ObservationLayout",
    "ObservationTerm",
    "OneWay",
    "Outline",
    "Physics",
    "Population",
    "Pulls",
    "Recording",
    "RewardTerm",
    "RewardWeights",
    "Route",
    "Routing",
    "Scenario",
    "Section",
    "Simulation",
    "SocialForce",
    "SpeedZone",
    "Step",
    "Uniform",
    "Walking",
    "contact_pressure",
    "crowd_pressure",
    "evaluate",
    "make_bodies",
    "make_scenario",
    "make_scheme",
    "make_state",
    "make_task",
    "make_vec",
    "parallel_env",
    "read_starts",
    "record",
    "register",
    "rollout",
]


# What lies above this package: name -> module that has it, loaded when it is first asked for.
_ABOVE = {"evaluate": "crowd_env.agents.evaluation.evaluation", "record": "crowd_env.recording"}


def __getattr__(name: str) -> Any:
    if name not in _ABOVE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ABOVE[name]), name)


def register() -> None:
    """Register every scenario and every task as ``crowd_env/<name>`` with PettingZoo (both APIs) and Gymnasium (room, batch).

    What one controller decides for all is registered with Gymnasium alone.
    """
    of_tasks = {task.id: task for task in TASKS.values()}
    for name in (*SCENARIOS, *of_tasks):
        options = {"scenario": name}
        identity = f"crowd_env/{name}"
        if name in of_tasks and of_tasks[name].decides == "routing":
            made_by = _CONTROLLED["crowd_env/routing-v0"]
            if identity not in gymnasium.registry:
                gymnasium.register(identity, **made_by, kwargs=options)
            continue
        if identity not in gymnasium.registry:
            gymnasium.register(
                identity,
                entry_point="crowd_env.envs.gymnasium_env:CrowdGymEnv",
                vector_entry_point="crowd_env.envs.gymnasium_env:CrowdVectorEnv",
                kwargs=options,
            )
        if identity not in pettingzoo.parallel_registry:
            pettingzoo.register("parallel", identity, "crowd_env.envs.parallel:parallel_env", kwargs=options)
        if identity not in pettingzoo.aec_registry:
            pettingzoo.register("aec", identity, "crowd_env.envs.parallel:env", kwargs=options)
    for identity, made_by in _CONTROLLED.items():
        if identity not in gymnasium.registry:
            gymnasium.register(identity, **made_by)


register()
