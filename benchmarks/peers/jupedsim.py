"""JuPedSim: collision-free speed model and social force, their published parameters, a step of 0.01 s (its default)."""

from collections.abc import Iterator
from typing import Any

import jupedsim
import numpy as np
import shapely

from benchmarks.measuring import Effort
from benchmarks.peers.walking import DT, PeerCrowd
from benchmarks.scenes import Floats, Scene

_OUTSIDE = 1.5  # m of floor behind the door, where people are taken out


class JuPedSim(PeerCrowd):
    """A scene under one of its models; people's radius, desired speed, mass and relaxation time are those of the scene."""

    def __init__(self, social: bool, scene: Scene) -> None:
        self._social = social
        super().__init__("social force" if social else "collision-free speed", "jupedsim", scene)

    def _build(self) -> None:
        scene = self._scene
        low, high = scene.jambs
        room = shapely.box(0.0, 0.0, scene.side, scene.side)
        floor = room.union(shapely.box(scene.side - 0.01, low, scene.side + _OUTSIDE, high))
        model: Any = jupedsim.SocialForceModel() if self._social else jupedsim.CollisionFreeSpeedModel()
        self._simulation = jupedsim.Simulation(model=model, geometry=floor, dt=DT)
        stage = self._simulation.add_exit_stage(shapely.box(scene.side + 0.01, low, scene.side + _OUTSIDE, high))
        journey = self._simulation.add_journey(jupedsim.JourneyDescription([stage]))
        self._number: dict[int, int] = {}
        for k in range(scene.people):
            common: dict[str, Any] = {
                "journey_id": journey,
                "stage_id": stage,
                "position": (float(scene.position[k, 0]), float(scene.position[k, 1])),
                "radius": float(scene.bodies.radius[k]),
                "desired_speed": float(scene.bodies.desired_speed[k]),
            }
            if self._social:
                agent: Any = jupedsim.SocialForceModelAgentParameters(
                    mass=float(scene.bodies.mass[k]), reaction_time=float(scene.bodies.relaxation_time[k]), **common
                )
            else:
                agent = jupedsim.CollisionFreeSpeedModelAgentParameters(**common)
            self._number[self._simulation.add_agent(agent)] = k

    def _step(self) -> None:
        self._simulation.iterate(1)

    @property
    def inside(self) -> int:
        """Number of people inside."""
        return int(self._simulation.agent_count())

    def _people(self) -> tuple[np.ndarray, Floats]:
        agents = list(self._simulation.agents())
        position = np.array([agent.position for agent in agents]).reshape(-1, 2)
        return np.array([self._number[agent.id] for agent in agents], dtype=np.int64), position


def crowds(scene: Scene, effort: Effort) -> Iterator[JuPedSim]:
    """Yield the scene under both models."""
    yield from (JuPedSim(social, scene) for social in (False, True))
