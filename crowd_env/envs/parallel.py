"""PettingZoo ParallelEnv: one evacuation as dictionaries, one agent per pedestrian."""

import copy
from collections.abc import Callable, Iterable, Mapping
from functools import partial, wraps
from typing import Any

import gymnasium
import numpy as np
from pettingzoo import ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec

from crowd_env.checks import shown
from crowd_env.envs.client_input import as_numbers, check_options
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.global_state import StateLayout, StateReader
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Bools, Floats, Ints

RENDER_MODES = ("rgb_array", "human")


class CrowdParallelEnv(ParallelEnv):
    """One evacuation; every pedestrian is an agent, ``pedestrian_0`` to ``pedestrian_{N-1}``.

    Observation, action and reward of an agent are the rows of `CrowdEnv`, which see.  An action of None, or none at all for an
    agent, lets the rule decide: the pedestrian walks the shortest path.  Learned and ruled pedestrians can share a room.

    Who gets out leaves ``agents`` in the step in which he gets out, with his last observation and reward and
    ``terminated = True``.  Actions for him are ignored from then on, whatever they are: clients with a fixed group of agents
    go on sending some.  At the time limit all who are left are truncated.  After the end, ``step`` returns five empty
    dictionaries.

    The info of an agent holds the terms of his reward, unweighted, as ``reward/<name>``, and in the last step of an episode
    its ``metrics``.  Infos are written when they are first looked at, see `UnreadInfos`; nothing changes them later.

    Parameters
    ----------
    scenario : name in ``SCENARIOS`` or a Scenario.
    render_mode : None, "rgb_array" or "human".
    max_cycles : decision steps after which the episode is truncated; replaces ``time_limit``.
    options : everything else `CrowdEnv` takes: scheme, dt, decision_dt, frame, action, observation, reward ...

    Attributes
    ----------
    possible_agents, agents : names of all pedestrians, and of those who are inside; of nobody before the first `reset`.
    state_layout, state_space : what the numbers of `state` mean, and their bounds.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.

    Examples
    --------
    >>> import crowd_env
    >>> env = crowd_env.parallel_env("room-v0", scheme="nsm2")
    >>> observations, infos = env.reset(seed=0)
    >>> while env.agents:
    ...     actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    ...     observations, rewards, terminations, truncations, infos = env.step(actions)
    """

    metadata = {"name": "crowd_env", "render_modes": list(RENDER_MODES), "render_fps": 10, "is_parallelizable": True}

    def __init__(
        self,
        scenario: str | Scenario = "room-v0",
        *,
        render_mode: str | None = None,
        max_cycles: int | None = None,
        **options: Any,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"unknown render_mode {render_mode!r}; known: None, {', '.join(RENDER_MODES)}")
        for name in ("num_envs", "autoreset"):
            if name in options:
                raise ValueError(f"a ParallelEnv is one evacuation; {name} belongs to CrowdEnv or crowd_env.make_vec")
        self.env = CrowdEnv(scenario, num_envs=1, **options)
        if max_cycles is not None:
            self.max_cycles = max_cycles
        self.render_mode = render_mode
        self.possible_agents = [f"pedestrian_{i}" for i in range(self.env.num_people)]
        self.agents: list[str] = []
        self._slots: Ints | slice = slice(None)  # of the agents
        self._nobody: dict[str, bool] = {}  # False for each of the agents
        self._slot = {agent: i for i, agent in enumerate(self.possible_agents)}
        self._state = StateReader(self.env)
        self.state_layout: StateLayout = self._state.layout
        self.state_space = self.state_layout.space()
        self._begun = False
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.env.decision_dt)}
        self._observation_spaces = {a: copy.deepcopy(self.env.single_observation_space) for a in self.possible_agents}
        self._action_spaces = {a: copy.deepcopy(self.env.single_action_space) for a in self.possible_agents}
        self._canvas: Any = None
        self._window: Any = None

    @property
    def max_cycles(self) -> int:
        """Decision steps until the time limit."""
        return round(float(self.env.time_limit[0]) / self.env.decision_dt)

    @max_cycles.setter
    def max_cycles(self, cycles: int) -> None:
        if isinstance(cycles, bool) or not isinstance(cycles, int | np.integer) or cycles < 1:
            raise ValueError(f"max_cycles is {cycles!r}; it must be a whole number >= 1")
        self.env.time_limit[:] = cycles * self.env.decision_dt

    # Every agent has its own space, made once: seeding one must not seed another.
    def observation_space(self, agent: str) -> gymnasium.spaces.Box:
        """Return the observation space of an agent."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.Space:
        """Return the action space of an agent."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Start an evacuation; the same seed gives the same people in the same places.

        Raises
        ------
        ValueError
            If the seed is no whole number >= 0, or there are options: all are given when the environment is made.
        """
        check_options(options, idle=("options",))  # PettingZoo's own checkers give it to every environment
        observation, _ = self.env.reset(None if seed is None else [seed])
        self._begun = True
        self._let_stay(list(self.possible_agents), slice(None))
        if self.render_mode == "human":
            self.render()
        return dict(zip(self.agents, observation, strict=True)), {agent: {} for agent in self.agents}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Advance by one decision step.

        Raises
        ------
        ValueError
            If an action is malformed or not finite or belongs to an agent that there never was, or before the first `reset`.
        """
        self._check_begun("the first step")
        action, rule = self._gather(actions)
        if not self.agents:
            return {}, {}, {}, {}, {}
        agents, slots = self.agents, self._slots
        step = self.env.step(action, rule)
        observations = dict(zip(agents, step.observation[slots], strict=True))
        rewards = dict(zip(agents, step.reward[slots].tolist(), strict=True))
        infos = UnreadInfos(self._nobody, partial(_write_infos, self._nobody, slots, step.info))
        terminations, truncations = self._nobody.copy(), self._nobody.copy()
        if (step.terminated | step.truncated).any():
            terminations = dict(zip(agents, step.terminated[slots].tolist(), strict=True))
            truncations = dict(zip(agents, step.truncated[slots].tolist(), strict=True))
            stay = np.flatnonzero(self.env.active)
            self._let_stay([self.possible_agents[i] for i in stay.tolist()], stay)
        if self.render_mode == "human":
            self.render()
        return observations, rewards, terminations, truncations, infos

    def _let_stay(self, agents: list[str], slots: Ints | slice) -> None:
        """Remember who is inside; their slots are a slice while that is everybody: it copies nothing."""
        self.agents, self._slots = agents, slots
        self._nobody = dict.fromkeys(agents, False)

    def _check_begun(self, what: str) -> None:
        if not self._begun:
            raise ValueError(f"call reset before {what}")

    def _gather(self, actions: Mapping[str, Any]) -> tuple[Floats, Bools | None]:
        """Return actions by slot, and who follows the rule; None if nobody does."""
        if not isinstance(actions, Mapping):
            raise ValueError(
                f"actions is {shown(actions)}; it must be a dictionary of agents and their actions "
                "(who is not in it follows the rule)"
            )
        gathered = np.zeros((self.env.num_people, *(self.env.single_action_space.shape or ())))
        if list(actions) != self.agents:
            for agent in actions:
                if agent not in self._slot:
                    known = f"{self.possible_agents[0]} to {self.possible_agents[-1]}"
                    raise ValueError(f"action for {agent!r}: there is no such agent; known: {known}")
            actions = {agent: actions[agent] for agent in self.agents if agent in actions}  # who is out acts no more
        if (
            len(actions) == len(self.agents)
            and (whole := _stacked(list(actions.values()), gathered.shape[1:])) is not None
        ):
            gathered[self._slots] = whole
            return gathered, None
        rule = np.ones(self.env.num_people, dtype=np.bool_)
        for agent, action in actions.items():
            if action is not None:
                i = self._slot[agent]
                gathered[i] = as_numbers(action, gathered.shape[1:], f"action of {agent}")
                rule[i] = False
        return gathered, rule

    def state(self) -> np.ndarray:
        """Return the whole crowd (``state_layout.size``,) float32 for a centralised critic, see `StateLayout`.

        Bodies, places, velocities and ways of everybody, the exits and the time left, in SI units.  The length depends on the
        number of people and of exit lines alone.

        Raises
        ------
        ValueError
            Before the first `reset`.
        """
        self._check_begun("state")
        return self._state.read()

    def render(self) -> np.ndarray | None:
        """Return a frame (H, W, 3) uint8, or show it in a window; None without a render mode.

        Raises
        ------
        ValueError
            Before the first `reset`.
        """
        if self.render_mode is None:
            return None
        self._check_begun("render")
        from crowd_env.rendering import Window
        from crowd_env.rendering.live import draw_env

        frame, self._canvas = draw_env(self.env, self._canvas)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = Window(fps=1.0 / self.env.decision_dt)
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Close the window, if any."""
        if self._window is not None:
            self._window.close()
            self._window = None


def _stacked(actions: list[Any], shape: tuple[int, ...]) -> np.ndarray | None:
    """Return actions as one array (N, *shape) of numbers; None unless everyone has one of that shape."""
    try:
        whole = np.array(actions)  # a fifth faster than with a dtype
    except (TypeError, ValueError):
        return None
    return whole if whole.dtype.kind in "biuf" and whole.shape == (len(actions), *shape) else None


class Infos(dict[str, dict[str, Any]]):
    """The infos of a step: a dictionary, whose copies and pickles are plain ones."""

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


class UnreadInfos(Infos):
    """Infos whose values are written when someone first looks: few do, and it takes as long as all other dictionaries.

    The first call of a method that could show or change a value writes them; from then on they are `Infos`, whose methods are
    a dictionary's own.  The keys are there at once, since C code, as that of json, takes the length without calling one.

    Parameters
    ----------
    keys : a dictionary with the keys.
    write : returns the dictionary that it is to become.
    """

    def __init__(self, keys: Any = (), write: Callable[[], dict[str, dict[str, Any]]] = dict) -> None:
        super().__init__(keys)
        self._write = write

    def read(self) -> None:
        """Write the values."""
        dict.update(self, self._write())
        self.__class__ = Infos  # type: ignore[assignment]
        del self._write


def _read_first(name: str) -> Callable[..., Any]:
    """Return a method of dictionaries, for those that are unread."""
    method = getattr(dict, name)

    @wraps(method)
    def read_and_call(*args: Any, **kwargs: Any) -> Any:
        for infos in args:  # the first one, and what it is compared with
            if isinstance(infos, UnreadInfos):
                infos.read()
        return method(*args, **kwargs)

    return read_and_call


for _names in (
    "__getitem__ __setitem__ __delitem__ __iter__ __reversed__ __repr__ __eq__ __ne__ __or__ __ror__ __ior__",
    "get keys values items copy pop popitem setdefault update clear",
):
    for _name in _names.split():
        setattr(UnreadInfos, _name, _read_first(_name))


def _write_infos(agents: Iterable[str], slots: Ints | slice, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return for each agent the terms of his reward and, if the episode is over, its metrics."""
    terms = {name: values[slots].tolist() for name, values in info.items() if name.startswith("reward/")}
    infos: dict[str, dict[str, Any]] = dict(zip(agents, _records(terms), strict=True))
    for metrics in info["metrics"].values():
        for agent in agents:
            infos[agent]["metrics"] = metrics._asdict()
    return infos


def _records(columns: dict[str, list[float]]) -> list[dict[str, float]]:
    """Return a dictionary for each row of some columns."""
    if len(columns) == 4:  # as many as there are reward terms, but for terms of one's own: half the time
        (a, b, c, d), values = columns, zip(*columns.values(), strict=True)
        return [{a: one, b: two, c: three, d: four} for one, two, three, four in values]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def parallel_env(scenario: str | Scenario = "room-v0", **options: Any) -> CrowdParallelEnv:
    """Return one evacuation as a PettingZoo ParallelEnv; see `CrowdParallelEnv`."""
    return CrowdParallelEnv(scenario, **options)


def env(scenario: str | Scenario = "room-v0", **options: Any) -> Any:
    """Return the same as a PettingZoo AEC environment (agents act in turn, physics moves when all have)."""
    return parallel_to_aec(parallel_env(scenario, **options))


raw_env = parallel_env
