"""The bases of this package's Gymnasium environments: E evacuations with one controller each, one alone or all in arrays."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol, TypeAlias, cast

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.checks import array, known, whole
from crowd_env.envs.action import Masks
from crowd_env.envs.arguments import NUMBERS, check_options, reset_mask
from crowd_env.envs.crowd import CrowdEnv, Reset
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.restorable import Restorable

Row: TypeAlias = tuple[np.ndarray, float, bool, bool, dict[str, Any]]
"""What a step of one environment returns: observation, reward, terminated, truncated and info."""


class BatchStep(NamedTuple):
    """The effect of one step on E environments."""

    observation: np.ndarray  # (E, ...)  where an episode has restarted, the first of the new one
    final: np.ndarray | None  # (E, ...)  where an episode has restarted, the last of the old one; None if none has
    reward: Floats  # (E,)
    terminated: Bools  # (E,)
    truncated: Bools  # (E,)
    info: dict[str, Any]  # name -> (E, ...), or a dictionary of such; always of the step that was made
    metrics: Mapping[int, EpisodeMetrics]  # environment -> metrics of the episode that ended in this step


class Batch(Protocol):
    """E environments with one controller each; an episode that has ended stays as it is, with reward 0, until it restarts."""

    env: CrowdEnv
    layout: Any  # where the columns of an observation are

    @property
    def made_by(self) -> dict[str, Any]:
        """What a batch must have in common with this one to take up its checkpoints, beside that of ``env``."""

    @property
    def duration(self) -> float:
        """Simulated time of a step [s]."""

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Space of the observations of one environment."""

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """Space of the actions of one environment."""

    @property
    def action_mask(self) -> Masks | None:
        """Choices that count now (E, ...) int8, entry by entry of an action; None where all always do."""

    def info_at_reset(self) -> dict[str, np.ndarray]:
        """Return the infos of a reset, (E, ...) each, in arrays that belong to the caller."""

    def reset(self, seed: int | Sequence[int | None] | None = None, mask: Bools | None = None) -> np.ndarray:
        """Start new episodes everywhere, or where ``mask`` (E,) is true; return observations (E, ...), valid there."""

    def step(self, actions: Any) -> BatchStep:
        """Advance by one step; if the batch was made with ``autoreset``, restart each episode that ends in it."""


def frame_rate(duration: float) -> float:
    """Return the frames a second at which films of steps of ``duration`` [s] run in real time; a whole number if it is one."""
    rate = 1.0 / duration
    return round(rate) if abs(rate - round(rate)) < 1e-9 * rate else rate


class _OfBatch(Restorable):
    """An environment over a `Batch`; its Gymnasium spec has the id of a task only if nothing is another than there."""

    metadata: dict[str, Any]
    _spec: EnvSpec | None = None

    def _take_up(self, batch: Batch, render_mode: str | None) -> None:
        check_render_mode(render_mode)
        self.batch, self.env, self.layout = batch, batch.env, batch.layout
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": frame_rate(batch.duration)}
        self._canvas: list[Any] = []

    def _made_by(self) -> dict[str, Any]:
        return {**super()._made_by(), **self.batch.made_by}

    @property
    def spec(self) -> EnvSpec | None:
        """How Gymnasium made it."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        marked = f"crowd_env/{self.env.id}".replace(",", "").replace(" ", "-")
        self._spec = replace(spec, id=marked) if spec is not None and self.env.changed else spec


class SingleEnv(_OfBatch, gymnasium.Env):
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
    _kept = ("_np_random", "_np_random_seed")

    def __init__(self, batch: Batch, render_mode: str | None = None) -> None:
        self._take_up(batch, render_mode)
        self.observation_space, self.action_space = batch.observation_space, batch.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Reset:
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
        observation = self.batch.reset([draw])[0]
        self._agree()
        return observation, _first(self.batch.info_at_reset())

    def step(self, action: Any) -> Row:
        """Advance by one step.

        Raises
        ------
        ValueError
            If the action is not one of the action space, or before the first `reset`.
        """
        self._check_whole()
        return self._row(self.batch.step(array("the action", action, self.action_space.shape or (), NUMBERS)[None]))

    @property
    def action_masks(self) -> Callable[[], Masks]:
        """Method that returns the choices that count now, as ``MaskablePPO`` asks for it; no attribute where all always do."""
        if self.batch.action_mask is None:
            raise AttributeError(f"every choice of the {type(self).__name__} always counts: it has no masks")
        return lambda: cast(Masks, self.batch.action_mask)[0]

    def _row(self, made: BatchStep) -> Row:
        info = _first(made.info)
        for metrics in made.metrics.values():
            info["metrics"], info["score"] = metrics._asdict(), metrics.score
        return made.observation[0], float(made.reward[0]), bool(made.terminated[0]), bool(made.truncated[0]), info

    def render(self) -> np.ndarray | None:
        """Return a frame (H, W, 3) uint8, None without a render mode."""
        return None if self.render_mode is None else frames_of(self.env, self._canvas)[0]


def frames_of(env: CrowdEnv, canvas: list[Any]) -> list[np.ndarray]:
    """Return a frame (H, W, 3) uint8 of each environment, all of one size; ``canvas`` keeps what frames share."""
    from crowd_env.rendering.frames import draw_envs

    return draw_envs(env, canvas)


def check_render_mode(mode: str | None, modes: Sequence[str] = ("rgb_array",)) -> None:
    """Raise ValueError if a render mode is neither None nor one of ``modes``."""
    if mode not in (None, *modes):
        raise ValueError(f"unknown render_mode {mode!r}; known: None, {', '.join(modes)}")


def _first(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the first row of arrays (1, ...), and of dictionaries of such; scalars as Python's."""
    row: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            row[name] = _first(value)
        else:
            row[name] = value[0].item() if value.ndim == 1 else value[0]
    return row


class BatchVectorEnv(_OfBatch, VectorEnv):
    """The E environments of a `Batch`, with the infos of `gymnasium.vector.SyncVectorEnv` around E single ones.

    Every entry of an info is an array (E, ...), or a dictionary of such, and has a mask ``_<name>`` (E,) bool of the
    environments concerned; rows of other environments are zero.  ``autoreset_mode``, which is also in ``metadata``, defines
    the treatment of an environment whose episode has ended:

    "SameStep" (default)
        It restarts in the same step and its row shows the first observation of the next episode.  ``info["final_obs"]`` holds
        the last observation of the old one and ``info["final_info"]`` the whole info of the step that ended it, its
        ``metrics`` included.  The other infos of that row are the infos of the reset.
    "NextStep"
        Its row shows the last observation, and the info its ``metrics``.  In the next step it restarts, whatever its action;
        reward 0.
    "Disabled"
        As "NextStep", but it has to be reset by ``reset(options={"reset_mask": mask})`` before the next step.

    Parameters
    ----------
    make : makes the environments; it receives ``autoreset``, whether environments that end restart at once.
    autoreset_mode : an `AutoresetMode` or its value.
    render_mode : None or "rgb_array".
    max_episode_steps : steps until the time limit; by default that of the place.

    Attributes
    ----------
    layout : where the columns of an observation are.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": ["rgb_array"]}
    _kept = ("_begun", "_ended", "_last", "_np_random_seed")

    def __init__(
        self,
        make: Callable[..., Batch],
        autoreset_mode: AutoresetMode | str,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
    ) -> None:
        if not isinstance(autoreset_mode, AutoresetMode):
            known("autoreset_mode", autoreset_mode, [one.value for one in AutoresetMode])
        self.autoreset_mode = mode = AutoresetMode(autoreset_mode)
        batch = make(autoreset=mode is AutoresetMode.SAME_STEP)
        if max_episode_steps is not None:
            batch.env.cut_off(whole("max_episode_steps", max_episode_steps) * batch.duration)
        self._take_up(batch, render_mode)
        self.num_envs = num_envs = batch.env.num_envs
        self.metadata |= {"autoreset_mode": mode}
        self.single_observation_space, self.single_action_space = batch.observation_space, batch.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._begun = False
        self._ended = np.zeros(num_envs, dtype=bool)  # and not yet restarted
        # Rows as last returned: a reset of some environments returns the others unchanged.
        self._last = np.zeros(self.observation_space.shape or (), dtype=self.observation_space.dtype)

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> Reset:
        """Start new episodes everywhere, or where ``options["reset_mask"]`` (E,) is true.

        Parameters
        ----------
        seed : as in `CrowdEnv.reset`; seeds of environments that are not reset are ignored.
        options : None or {"reset_mask": boolean array}; it stays unchanged.

        Returns
        -------
        All observations (E, ...), unchanged where no episode starts, and the infos of the new episodes.

        Raises
        ------
        ValueError
            If an option is unknown or the mask no boolean array (E,) with a True, or if the first reset is of some only.
        """
        mask = reset_mask(options, self.num_envs)
        if mask is None:
            mask = np.ones(self.num_envs, dtype=bool)
            observation = self.batch.reset(seed)
            self._agree()
        elif not self._begun:
            raise ValueError("reset all environments before some of them")
        else:
            fresh, observation = self.batch.reset(seed, mask), self._last.copy()
            observation[mask] = fresh[mask]
        if seed is not None:
            self._np_random_seed = seed if isinstance(seed, int) else tuple(seed)  # type: ignore[assignment]  # as SyncVectorEnv
        self._begun = True
        self._ended[mask] = False
        self._last[:] = observation
        return observation, about(self.batch.info_at_reset(), mask)

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every environment by one step; ``actions`` have the shape of ``action_space`` and no other.

        Raises
        ------
        ValueError
            If actions are malformed, before the first `reset`, or if an environment waits to be reset.
        """
        if not self._begun:
            raise ValueError("call reset before the first step")
        self._check_whole()
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            e = int(np.argmax(self._ended))
            raise ValueError(f"environment {e} has ended; reset it first: reset(options={{'reset_mask': mask}})")
        made = self.batch.step(array("the array of actions", actions, self.action_space.shape or (), NUMBERS))
        observation, over = made.observation, made.terminated | made.truncated
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        restarted = over if same_step else self._ended
        if not same_step and restarted.any():
            observation[restarted] = self.batch.reset(mask=restarted)[restarted]
        info = about(made.info, ~restarted)
        for name, values in self.batch.info_at_reset().items() if restarted.any() else ():
            info[name][restarted], info[f"_{name}"][restarted] = values[restarted], True
        if over.any():
            score = np.array([made.metrics[e].score if e in made.metrics else 0.0 for e in range(self.num_envs)])
            at_end: dict[str, Any] = {"metrics": as_columns(made.metrics, self.num_envs), "score": score}
            if made.final is not None:
                at_end = {"final_obs": made.final, "final_info": made.info | at_end}
            info |= about(at_end, over)
        if not same_step:
            self._ended = over
        self._last[:] = observation
        return observation, made.reward, made.terminated, made.truncated, info

    @property
    def action_mask(self) -> Masks | None:
        """Choices that count now (E, ...); None where all always do."""
        return self.batch.action_mask

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return a frame (H, W, 3) uint8 of each environment, None without a render mode."""
        return None if self.render_mode is None else tuple(frames_of(self.env, self._canvas))

    def _made_by(self) -> dict[str, Any]:
        return {**super()._made_by(), "autoreset_mode": self.autoreset_mode.value}


def about(values: Mapping[str, Any], rows: Bools) -> dict[str, Any]:
    """Return infos (E, ...) of these ``rows`` (E,) as Gymnasium has them: each beside its mask, zero in the other rows."""
    info: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            info[name] = about(value, rows)
        else:
            info[name] = value.copy()
            info[name][~rows] = 0
        info[f"_{name}"] = rows.copy()
    return info


def as_columns(metrics: Mapping[int, EpisodeMetrics], count: int) -> dict[str, np.ndarray]:
    """Return metrics {environment: metrics} as one array (``count``,) a field, zero where there are none."""
    columns: dict[str, np.ndarray] = {}
    for e, episode in metrics.items():
        for name, value in episode._asdict().items():
            columns.setdefault(name, np.zeros(count, dtype=type(value)))[e] = value
    return columns
