"""Drawing and recording an environment while it runs."""

import numpy as np

from crowd_env.analysis.pressure import contact_pressure
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.palette import FULL_PRESSURE
from crowd_env.rendering.recordings import Recording
from crowd_env.state import Floats


def _pressure(env: CrowdEnv, e: int) -> Floats:
    """Return the contact pressure (N,) [N/m] on everyone since the last decision."""
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
        clock=float(state.time[e]),
    )
    return frame, renderer


class Recorder:
    """Keeps what one environment of a batch looked like, decision by decision.

    Call `snap` after the reset and after every step, then take the `recording`.
    """

    def __init__(self, env: CrowdEnv, e: int = 0) -> None:
        self.env, self.e = env, e
        self._samples: list[tuple[float, Floats, Floats, np.ndarray, Floats]] = []

    def snap(self) -> None:
        """Keep the present moment."""
        people, state = self.env.people(self.e), self.env.simulation.state
        inside = np.isnan(state.exit_time[people])  # also those whom the time limit stopped
        self._samples.append(
            (
                float(state.time[self.e]),
                state.position[people].copy(),
                state.velocity[people].copy(),
                inside,
                _pressure(self.env, self.e),
            )
        )

    def recording(self, title: str = "") -> Recording:
        """Return all moments kept so far."""
        time, position, velocity, active, pressure = (np.array(column) for column in zip(*self._samples, strict=True))
        people = self.env.people(self.e)
        return Recording(
            time=time,
            position=position,
            velocity=velocity,
            active=active,
            pressure=pressure,
            radius=self.env.simulation.bodies.radius[people].copy(),
            geometry=self.env.scenario_of_env[self.e].geometry,
            title=title,
            exit_time=self.env.simulation.state.exit_time[people].copy(),
        )
