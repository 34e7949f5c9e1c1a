"""Drawing and recording an environment while it runs."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Driver, rollout
from crowd_env.physics.pressure import contact_pressure
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.palette import FULL_PRESSURE
from crowd_env.rendering.recordings import Recording
from crowd_env.scenarios.scenario import Scenario


def _pressure(env: CrowdEnv, e: int) -> Floats:
    """Return the contact pressure (N,) [N/m] on each person of environment ``e`` since the last decision."""
    people = env.people(e)
    simulation = env.simulation
    return contact_pressure(
        simulation.results.impulse_magnitude[people], env.decision_dt, simulation.bodies.radius[people]
    )


def draw_env(env: CrowdEnv, renderer: Renderer | None = None, e: int = 0) -> tuple[np.ndarray, Renderer]:
    """Return a frame (H, W, 3) uint8 of environment ``e``, and the renderer to hand in the next time."""
    if renderer is None:
        renderer = Renderer(env.scenario_of_env[e].geometry)
    people, state = env.people(e), env.simulation.state
    frame = renderer.frame(
        state.position[people],
        env.simulation.bodies.radius[people],
        active=state.active[people],
        color_value=np.clip(_pressure(env, e) / FULL_PRESSURE, 0.0, 1.0),
        velocity=state.velocity[people],
        angle=state.angle[people],
        outline=env.simulation.outline,
        clock=float(state.time[e]),
    )
    return frame, renderer


class FilmRecorder:
    """Keeps what the evacuations of a rollout looked like, decision by decision; the record of each is a `Recording`.

    Parameters
    ----------
    title : of the recordings.
    """

    def __init__(self, title: str = "") -> None:
        self.title = title

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Forget the batch before and keep the start of this one."""
        self._moments: list[list[tuple[float, Floats, Floats, Bools, Floats, Floats]]] = [
            [] for _ in range(env.num_envs)
        ]
        self._keep(env)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Keep the moment after a step."""
        self._keep(env)

    def record(self, env: CrowdEnv, e: int) -> Recording:
        """Return all moments of environment ``e`` kept so far."""
        columns = zip(*self._moments[e], strict=True)
        time, position, velocity, active, pressure, angle = (np.array(column) for column in columns)
        people, outline = env.people(e), env.simulation.outline
        if len(angle) > 1:
            angle[0] = angle[1]  # people face their way from the first step on
        parts = env.scenario_of_env[e].population.parts
        several = len(parts) > 1
        return Recording(
            time=time,
            position=position,
            velocity=velocity,
            active=active,
            pressure=pressure,
            radius=env.simulation.bodies.radius[people].copy(),
            geometry=env.scenario_of_env[e].geometry,
            title=self.title,
            exit_time=env.simulation.state.exit_time[people].copy(),
            angle=None if outline is None else angle,
            outline=outline,
            group=np.repeat(np.arange(len(parts)), [part.people for part in parts]) if several else None,
            groups=tuple(part.name or f"group {k + 1}" for k, part in enumerate(parts)) if several else (),
        )

    def _keep(self, env: CrowdEnv) -> None:
        state = env.simulation.state
        for e, moments in enumerate(self._moments):
            time, people = float(state.time[e]), env.people(e)
            if moments and moments[-1][0] == time:
                continue  # this evacuation has ended already
            inside = np.isnan(state.exit_time[people])  # also people whom the time limit stopped
            where = state.position[people].copy(), state.velocity[people].copy()
            moments.append((time, *where, inside, _pressure(env, e), state.angle[people].copy()))


def record(
    scenario: Scenario,
    *,
    seed: int = 0,
    title: str = "",
    driver: Callable[[int], Driver] | None = None,
    **options: Any,
) -> Recording:
    """Return one evacuation, a moment a decision step; the options are those of `crowd_env.envs.rollout.rollout`.

    Raises
    ------
    ValueError
        If an option is unknown or out of range, or the crowd does not fit.
    """
    (episode,) = rollout(scenario, 1, seed=seed, driver=driver, recorder=FilmRecorder(title), **options)
    recording: Recording = episode.record
    return recording
