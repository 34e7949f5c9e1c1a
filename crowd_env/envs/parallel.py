"""PettingZoo ParallelEnv: one evacuation as dictionaries, one agent per pedestrian."""

import copy
import math
from collections.abc import Mapping
from typing import Any, Unpack

import gymnasium
import numpy as np
from pettingzoo import ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.checks import array, refuse, whole
from crowd_env.envs.arguments import NUMBERS, Place, check_options
from crowd_env.envs.controlled import check_render_mode, frame_rate
from crowd_env.envs.crowd import CrowdEnv, Step, require_same_spaces
from crowd_env.envs.global_state import StateLayout, StateReader
from crowd_env.envs.restorable import Restorable
from crowd_env.envs.settings import EnvArguments, answers_unknown

RENDER_MODES = ("rgb_array", "human")


class CrowdParallelEnv(Restorable, ParallelEnv):
    """One evacuation; every pedestrian is an agent, ``pedestrian_0`` to ``pedestrian_{N-1}``.

    Observation, action and reward of an agent are the rows of `CrowdEnv`.  An action of None, or none at all for an agent,
    makes it scripted: the pedestrian walks along the route at full speed.  Both kinds can share a room.

    A pedestrian that comes in later joins ``agents`` in that step, with its first observation and the reward 0.  While the
    place is empty and people are to come, time passes within the step: without agents an environment is over.

    A pedestrian that gets out leaves ``agents`` in that step, with a last observation and reward and ``terminated = True``.
    Later actions for that agent are ignored: clients with a fixed group of agents continue to send some.  At
    the time limit all agents that are left are truncated.  After the end, ``step`` returns five empty dictionaries.

    The info of an agent holds the terms of its reward, unweighted, as ``reward/<name>``, and in the last step of an episode
    the ``metrics`` of the episode.  Where actions move a share of the people, ``learned`` is whether they move this one, also
    at the reset; and where they choose exits, ``action_mask`` (n,) is 0 for exits that cannot be taken now.

    Parameters
    ----------
    scenario : as `CrowdEnv` takes it.
    render_mode : None, "rgb_array" or "human".
    max_cycles : decision steps after which the episode is truncated; replaces ``time_limit``.
    **arguments : all others of `CrowdEnv`, but for ``num_envs`` and ``autoreset``.

    Attributes
    ----------
    possible_agents, agents : names of all pedestrians that may come, and of the ones inside; none before the first `reset`.
    np_random : generator of the seed of `reset`, for wrappers; the crowd draws from others.
    cohorts : name -> agents of each cohort of the place, to group agents by.
    state_layout, state_space : the meaning of the numbers of `state`, and their bounds.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.

    Examples
    --------
    >>> import crowd_env
    >>> env = crowd_env.parallel_env("room-v0", people=30, physics="dem")
    >>> observations, infos = env.reset(seed=0)
    >>> while env.agents:
    ...     actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    ...     observations, rewards, terminations, truncations, infos = env.step(actions)
    """

    metadata = {"name": "crowd_env", "render_modes": list(RENDER_MODES), "render_fps": 10, "is_parallelizable": True}
    _kept = ("agents", "np_random", "_slots", "_begun", "_cycles")

    @answers_unknown(like=CrowdEnv)
    def __init__(
        self,
        scenario: Place = "room-v0",
        *,
        render_mode: str | None = None,
        max_cycles: int | None = None,
        **arguments: Unpack[EnvArguments],
    ) -> None:
        check_render_mode(render_mode, RENDER_MODES)
        self._arguments, self._cycles = arguments, max_cycles
        self._enter(CrowdEnv(scenario, **arguments))
        self.render_mode = render_mode
        self.np_random = np.random.default_rng()
        self.possible_agents = [f"pedestrian_{i}" for i in range(self.env.num_people)]
        self.agents: list[str] = []
        self._slots: Ints | slice = slice(None)  # of the agents; while these are all, indexing copies nothing
        self._slot = {agent: i for i, agent in enumerate(self.possible_agents)}
        self._begun = False
        self.metadata = {**self.metadata, "render_fps": frame_rate(self.env.decision_dt)}
        self._observation_spaces = {a: copy.deepcopy(self.env.single_observation_space) for a in self.possible_agents}
        self._action_spaces = {a: copy.deepcopy(self.env.single_action_space) for a in self.possible_agents}
        self._window: Any = None

    def _enter(self, env: CrowdEnv) -> None:
        """Let the next evacuation be that of another environment."""
        self.env = env
        self._canvas: list[Any] = []
        if self._cycles is not None:
            self.max_cycles = self._cycles
        self._state = StateReader(env)
        self.state_layout: StateLayout = self._state.layout
        self.state_space = self.state_layout.space()

    @property
    def max_cycles(self) -> int:
        """Decision steps until the time limit."""
        return math.ceil(float(self.env.time_limit[0]) / self.env.decision_dt - 1e-9)

    @max_cycles.setter
    def max_cycles(self, cycles: int) -> None:
        self._cycles = whole("max_cycles", cycles)
        self.env.cut_off(self._cycles * self.env.decision_dt)

    @property
    def cohorts(self) -> dict[str, list[str]]:
        """Name -> agents of each cohort of the place, such as the two streams of a counter-flow: a ``group_map``."""
        agents = self.possible_agents
        return {name: [agents[i] for i in np.flatnonzero(people).tolist()] for name, people in self.env.cohorts.items()}

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
        """Start an evacuation; the same seed gives the same people at the same positions.

        Parameters
        ----------
        options : None, or {"scenario": ...}, what `make_scenario` takes: the place from now on.  If it has fewer people than
            there are possible agents, the first of these are there.

        Raises
        ------
        ValueError
            If the seed is no whole number >= 0, an option is unknown, or the place holds more people or needs other spaces.
        """
        check_options(
            options, ("scenario",), idle=("options",)
        )  # PettingZoo's own checkers give it to every environment
        if options and "scenario" in options:
            env = CrowdEnv(options["scenario"], **self._arguments)
            if env.num_people > len(self.possible_agents):
                most = len(self.possible_agents)
                refuse("scenario", env.scenarios[0].name, f"a place of at most {most} people, not {env.num_people}")
            require_same_spaces(env, self.env)
            env.go_on_drawing(self.env)
            self._enter(env)
        observation, info = self.env.reset(None if seed is None else [seed])
        if not self.env.active.any():  # an agent acts from its entry on
            step = self._until_somebody_is_inside()
            observation, info = (
                step.observation,
                {name: step.info[name] for name in ("action_mask",) if name in step.info},
            )
        if seed is not None:
            self.np_random = np.random.default_rng(seed)
        self._begun = True
        self._agree()
        self._take_agents(self.env.active)
        if self.render_mode == "human":
            self.render()
        infos = _infos_of(self.agents, self._slots, info | self.env.moved)
        return dict(zip(self.agents, observation[self._slots], strict=True)), infos

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Advance by one decision step.

        Raises
        ------
        ValueError
            If an action is malformed or not finite or belongs to an unknown agent, or before the first `reset`.
        """
        self._check_begun("the first step")
        self._check_whole()
        if len(self.agents) != np.count_nonzero(self.env.simulation.state.active):
            raise ValueError(
                "env.agents was changed by hand; a step takes out pedestrians outside, a reset brings all back"
            )
        action, scripted = self._gather(actions)
        if not self.agents:
            return {}, {}, {}, {}, {}
        before = self.env.active
        step = self.env.step(action, scripted)
        if not (self.env.active.any() or self.env.finished.all()):
            step = _with_the_end_of(step, self._until_somebody_is_inside())
        here = self.env.active
        entered = here & ~before
        if entered.any():
            self._take_agents(before | entered)
        agents, slots = self.agents, self._slots
        observations = dict(zip(agents, step.observation[slots], strict=True))
        rewards, terminations, truncations = (
            dict(zip(agents, values[slots].tolist(), strict=True)) for values in step[1:4]
        )
        infos = _infos_of(agents, slots, step.info | self.env.moved)
        if (step.terminated | step.truncated).any():
            self._take_agents(here)
        if self.render_mode == "human":
            self.render()
        return observations, rewards, terminations, truncations, infos

    def _take_agents(self, there: Bools) -> None:
        """Let these people (P,) be the agents."""
        stay = np.flatnonzero(there)
        everyone = len(stay) == self.env.num_people
        self.agents = [self.possible_agents[i] for i in stay.tolist()]
        self._slots = slice(None) if everyone else stay

    def _until_somebody_is_inside(self) -> Step:
        """Let time pass in an empty place: an environment without agents is over, by PettingZoo's rules."""
        step = self.env.step(None)
        while not (self.env.active.any() or self.env.finished.all()):
            step = self.env.step(None)
        return step

    def _check_begun(self, what: str) -> None:
        if not self._begun:
            raise ValueError(f"call reset before {what}")

    def _gather(self, actions: Mapping[str, Any]) -> tuple[Floats, Bools | None]:
        """Return actions by slot, and which slots (P,) are scripted; None if none is."""
        if not isinstance(actions, Mapping):
            refuse("actions", actions, "a dictionary of agents and their actions; agents without one are scripted")
        gathered = np.zeros((self.env.num_people, *(self.env.single_action_space.shape or ())))
        if list(actions) != self.agents:
            for agent in actions:
                if agent not in self._slot:
                    known = f"{self.possible_agents[0]} to {self.possible_agents[-1]}"
                    raise ValueError(f"action for {agent!r}: there is no such agent; known: {known}")
            actions = {
                agent: actions[agent] for agent in self.agents if agent in actions
            }  # actions of pedestrians outside are ignored
        every = _stacked(list(actions.values()), gathered.shape[1:])
        if every is not None and len(every) == len(self.agents):
            gathered[self._slots] = every
            return gathered, None
        scripted = np.ones(self.env.num_people, dtype=bool)
        for agent, action in actions.items():
            if action is not None:
                i = self._slot[agent]
                gathered[i] = array(f"action of {agent}", action, gathered.shape[1:], NUMBERS)
                scripted[i] = False
        return gathered, scripted

    def state(self) -> np.ndarray:
        """Return the whole crowd (``state_layout.size``,) float32 for a centralized critic, see `StateLayout`.

        Bodies, positions, velocities and routes of all people, the exits and the time left, in SI units.  The length depends
        on the number of people and of exit lines alone.

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
        from crowd_env.rendering.frames import draw_env

        frame = draw_env(self.env, self._canvas)
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


def _with_the_end_of(step: Step, last: Step) -> Step:
    """Return a step after which time has passed without anybody inside, with what the ``last`` step then saw."""
    return step._replace(
        observation=np.where(step.terminated[:, None], step.observation, last.observation),
        info={**last.info, **{name: step.info[name] for name in step.info if name.startswith("reward/")}},
    )


def _infos_of(agents: list[str], slots: Ints | slice, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return for each agent the terms of its reward, whether it is moved, its mask and, if the episode is over, the metrics."""
    of_each = [name for name in info if name == "learned" or name.startswith("reward/")]
    terms = {name: info[name][slots].tolist() for name in of_each}
    if "action_mask" in info:
        terms["action_mask"] = [*info["action_mask"][slots]]
    over = info.get("metrics", {}).values()
    ended = [entry for one in over for entry in (("metrics", one._asdict()), ("score", one.score))]
    rows = zip(*terms.values(), strict=True) if terms else [()] * len(agents)
    return {agent: dict([*zip(terms, row, strict=True), *ended]) for agent, row in zip(agents, rows, strict=True)}


def _stacked(actions: list[Any], shape: tuple[int, ...]) -> np.ndarray | None:
    """Return actions as one array (N, *shape) of numbers; None unless each is of that shape."""
    try:
        every = np.array(actions)  # a fifth faster than with a dtype
    except (TypeError, ValueError):
        return None
    return every if every.dtype.kind in NUMBERS and every.shape == (len(actions), *shape) else None


parallel_env = raw_env = CrowdParallelEnv


class _Changing(Restorable):
    """What a wrapper of PettingZoo keeps: all of it but the environment inside."""

    def _keep(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != self._behind}


class _InTurn(_Changing, parallel_to_aec_wrapper):
    """A `CrowdParallelEnv` whose agents act in turn."""

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Start an evacuation."""
        super().reset(seed, options)
        self._agree()

    def step(self, action: Any) -> None:
        """Take the action of the agent in turn."""
        self._check_whole()
        super().step(action)


class CrowdAECEnv(_Changing, OrderEnforcingWrapper):
    """A `CrowdParallelEnv` as a PettingZoo AEC environment: agents act in turn, then physics moves."""


@answers_unknown(like=CrowdParallelEnv)
def env(scenario: Place = "room-v0", **arguments: Any) -> Any:
    """Return a `CrowdParallelEnv` as a PettingZoo AEC environment: agents act in turn, then physics moves."""
    return CrowdAECEnv(_InTurn(CrowdParallelEnv(scenario, **arguments)))
