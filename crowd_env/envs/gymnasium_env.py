"""Gymnasium: one controller moves all pedestrians.  One room as an Env, many rooms as a natively batched VectorEnv.

For one agent per pedestrian see `crowd_env.envs.parallel` (PettingZoo) and `crowd_env.envs.adapters.sb3` (parameter sharing).
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar, Unpack

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from crowd_env.core.arrays.state import Bools, as_grid
from crowd_env.core.checks import refuse
from crowd_env.envs.action import Masks, mask_info
from crowd_env.envs.arguments import Place, check_options
from crowd_env.envs.controlled import BatchStep, BatchVectorEnv, Row, SingleEnv
from crowd_env.envs.crowd import CrowdEnv, Reset, require_same_spaces
from crowd_env.envs.settings import EnvArguments, answers_unknown


class CrowdBatch:
    """E rooms of N people each, the rows of a room's people side by side.

    Raises
    ------
    ValueError
        If rooms hold different numbers of people.
    """

    def __init__(self, scenario: Place | Sequence[Place], **arguments: Any) -> None:
        self.env = CrowdEnv(scenario, **arguments)
        self.layout = self.env.layout
        sizes = np.diff(self.env.env_start)
        if (sizes != sizes[0]).any():
            raise ValueError("a Gymnasium batch needs the same number of people in every scenario; CrowdEnv does not")
        self.observation_space = batch_space(self.env.single_observation_space, int(sizes[0]))
        self.action_space = batch_space(self.env.single_action_space, int(sizes[0]))

    made_by: ClassVar[dict[str, Any]] = {}

    @property
    def duration(self) -> float:
        """Simulated time of a step [s]: the decision step."""
        return self.env.decision_dt

    @property
    def action_mask(self) -> Masks | None:
        """Choices that count (E, N, n); None where all do."""
        mask = self.env.action_mask
        return None if mask is None else as_grid(mask, self.env.num_envs)

    def info_at_reset(self) -> dict[str, np.ndarray]:
        """Return ``active`` (E, N), what `CrowdEnv.moved` holds, and the ``action_mask``, if any."""
        everyone = {"active": self.env.active, **self.env.moved, **mask_info(self.env.action_mask)}
        return {name: as_grid(values, self.env.num_envs) for name, values in everyone.items()}

    def reset(self, seed: int | Sequence[int | None] | None = None, mask: Bools | None = None) -> np.ndarray:
        """Start new episodes everywhere, or where ``mask`` (E,) is true; return all observations (E, N, D)."""
        return as_grid(self.env.reset(seed, mask)[0], self.env.num_envs)

    def step(self, actions: np.ndarray | None) -> BatchStep:
        """Advance by one decision step; without actions (E, N, ...) all pedestrians are scripted."""
        env, rooms, moved = self.env, self.env.num_envs, self.env.moved
        step = env.step(None if actions is None else actions.reshape(env.num_people, *actions.shape[2:]))
        final, active = step.info.get("final_observation"), env.active
        if final is not None:  # a restarted room was empty at the end
            active[step.info["finished"][env.env_of_person]] = False
        truncated = np.asarray(as_grid(step.truncated, rooms).any(axis=1))
        of_people = {name: values for name, values in step.info.items() if name.startswith("reward/")}
        of_people |= {"reward": step.reward, **moved, **mask_info(env.masked(active)), "active": active}
        info: dict[str, Any] = {name: as_grid(values, rooms) for name, values in of_people.items()}
        info["diagnostics"] = step.info["diagnostics"]._asdict()
        return BatchStep(
            as_grid(step.observation, rooms),
            None if final is None else as_grid(final, rooms),
            as_grid(step.reward, rooms).mean(axis=1),
            np.logical_and(step.info["finished"], ~truncated),
            truncated,
            info,
            step.info["metrics"],
        )


class CrowdGymEnv(SingleEnv):
    """One room, one controller for all N people.

    Observation (N, D) and action (N, 2) (or N choices of 9) are the rows of `CrowdEnv`; the reward is the mean over the N
    people.  Without an action (None) all pedestrians are scripted.
    Terminated when all are out, truncated at the time limit.

    The info of a step holds the reward of each as ``reward`` (N,) and its terms, unweighted, as ``reward/<name>`` (N,);
    ``active`` (N,), true for people inside; ``diagnostics``, a dictionary of overlaps and of the solver's residual and
    iterations; and in the last step of an episode ``metrics``, the fields of `EpisodeMetrics` as a dictionary.  The info of a
    reset holds ``active``.  Where actions move a share of the people, both hold ``learned`` (N,), true for these; where they
    choose exits, ``action_mask`` (N, n), 0 for an exit that cannot be taken now.

    Parameters
    ----------
    scenario : as `CrowdEnv` takes it; by default "room-v0".
    render_mode : None or "rgb_array".
    **arguments : all others of `CrowdEnv`, but for ``num_envs`` and ``autoreset``.
    """

    batch: CrowdBatch

    @answers_unknown(like=CrowdEnv)
    def __init__(
        self, scenario: Place = "room-v0", *, render_mode: str | None = None, **arguments: Unpack[EnvArguments]
    ) -> None:
        super().__init__(CrowdBatch(scenario, **arguments), render_mode)
        self._arguments = arguments

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Reset:
        """Start an episode; the same seed gives the same people at the same positions.

        Parameters
        ----------
        options : None, or {"scenario": ...}, what `make_scenario` takes, with as many people: the place from now on.

        Raises
        ------
        ValueError
            If the seed is no whole number >= 0, an option is unknown, or the place needs other spaces.
        """
        check_options(options, ("scenario",))
        if options and "scenario" in options:
            batch = CrowdBatch(options["scenario"], **self._arguments)
            require_same_spaces(batch.env, self.env)
            if batch.env.num_people != self.env.num_people:
                refuse(
                    "scenario", options["scenario"], f"a place of {self.env.num_people} people; give people= with it"
                )
            self.batch, self.env = batch, batch.env
        return super().reset(seed=seed)

    def step(self, action: Any) -> Row:
        """Advance by one decision step.

        Raises
        ------
        ValueError
            If the action is malformed or not finite, or before the first `reset`.
        """
        self._check_whole()
        return self._row(self.batch.step(None)) if action is None else super().step(action)


class CrowdVectorEnv(BatchVectorEnv):
    """Many rooms in one array, stepped together; each row equals `CrowdGymEnv`.

    For infos and restarts see `BatchVectorEnv`: a room that has finished restarts in the same step unless ``autoreset_mode``
    differs.

    Parameters
    ----------
    scenario : as `CrowdEnv` takes it, or several with the same number of people, dealt out in turn; by default "room-v0".
    num_envs : number of rooms E.
    autoreset_mode : "SameStep", "NextStep" or "Disabled".
    render_mode : None or "rgb_array".
    max_episode_steps : decision steps until the time limit; by default that of the place.
    **arguments : all others of `CrowdEnv`, but for ``autoreset``.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.
    """

    @answers_unknown(like=CrowdEnv)
    def __init__(
        self,
        scenario: Place | Sequence[Place] = "room-v0",
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        **arguments: Unpack[EnvArguments],
    ) -> None:
        make = partial(CrowdBatch, scenario, num_envs=num_envs, **arguments)
        super().__init__(make, autoreset_mode, render_mode, max_episode_steps)


make_vec = CrowdVectorEnv
