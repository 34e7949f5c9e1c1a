"""The base of this package's Gymnasium environments with one controller: the only row of a batch of one."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from crowd_env.core.checks import array
from crowd_env.envs.arguments import NUMBERS, check_options
from crowd_env.envs.batch import Batch, BatchStep


class SingleEnv(gymnasium.Env):
    """One environment of a `Batch`.

    Parameters
    ----------
    batch : of one environment.
    render_mode : None or "rgb_array".

    Attributes
    ----------
    layout : where the columns of the observation are.

    Raises
    ------
    ValueError
        If the render mode is unknown.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, batch: Batch, render_mode: str | None = None) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"unknown render_mode {render_mode!r}; known: None, rgb_array")
        self.batch, self.env, self.layout = batch, batch.env, batch.layout
        self.observation_space, self.action_space = batch.observation_space, batch.action_space
        self.render_mode = render_mode
        self._canvas: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode; the same seed gives the same people at the same positions.

        Raises
        ------
        ValueError
            If there are options, or the seed is no whole number >= 0.
        """
        check_options(options)
        super().reset(seed=seed)
        # Without a seed the episode follows from Gymnasium's own generator, so that one seed fixes a whole series.
        draw = int(self.np_random.integers(2**31)) if seed is None else seed
        return self.batch.reset([draw])[0], _first(self.batch.info_at_reset())

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one step.

        Raises
        ------
        ValueError
            If the action is not one of the action space, or before the first `reset`.
        """
        return self._row(self.batch.step(array("the action", action, self.action_space.shape or (), NUMBERS)[None]))

    def _row(self, made: BatchStep) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        info = _first(made.info)
        for metrics in made.metrics.values():
            info["metrics"] = metrics._asdict()
        return made.observation[0], float(made.reward[0]), bool(made.terminated[0]), bool(made.truncated[0]), info

    def render(self) -> np.ndarray | None:
        """Return a frame (H, W, 3) uint8, None without a render mode."""
        if self.render_mode is None:
            return None
        from crowd_env.rendering.frames import draw_env

        frame, self._canvas = draw_env(self.env, self._canvas)
        return frame


def _first(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the first row of arrays (1, ...), and of dictionaries of such; scalars as Python's."""
    row: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            row[name] = _first(value)
        else:
            row[name] = value[0].item() if value.ndim == 1 else value[0]
    return row
