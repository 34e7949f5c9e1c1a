"""Double DQN of one network for everybody, off policy: independent Q-learning with shared parameters, over choices of speed.

What an order at a door is worth shows only where all keep it for a while.  Random choices of each person, anew every 0.1 s, never
show that: a body follows within half a second, and the others go on as before.  So a room explores as one: its people share one
random change of the last layer for some seconds (parameter noise, Plappert et al. 2018), by which the same situation leads to the
same choice.
"""

import copy
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from crowd_env import CrowdEnv

from ..networks import MLP
from ..trained import LearnedPolicy
from .training import env_options_of
from .watch import Watch

_LARGEST_GRADIENT = 10.0
_ADAPTS = 1.02  # by which the noise grows or shrinks in a decision


@dataclass(frozen=True)
class DQNSettings:
    """Hyperparameters, a line each."""

    learning_rate: float = 1e-3  # falls linearly to zero over the budget
    gamma: float = 0.98  # per decision step of 0.1 s
    n_steps: int = 10  # decision steps whose rewards are summed before a value is asked for
    capacity: int = 300_000  # decisions that are remembered
    batch_size: int = 2048
    warm_up: int = 20_000  # decisions before the first update
    explore: tuple[float, float] = (
        0.4,
        0.02,
    )  # share of choices other than the best: at first, and from then on when ...
    explored: float = 0.7  # ... this share of the budget is spent
    held: int = 40  # decision steps for which a room keeps to one change
    target_rate: float = 0.01  # of the way from the slow to the fast network, in every update
    hidden: int = 64  # units in each of two layers


class Transitions(NamedTuple):
    """K decisions and what came of them."""

    observation: np.ndarray  # (K, D)
    action: np.ndarray  # (K,)
    reward: np.ndarray  # (K,)  discounted, of the steps until ...
    after: np.ndarray  # (K, D)  ... this was observed
    discount: np.ndarray  # (K,)  of what comes then; 0 for those who got out


class Replay:
    """The last decisions of people who were inside; rows of those who have left never come in.

    Parameters
    ----------
    capacity : how many are kept; new ones replace the oldest.
    width : columns D of an observation.
    """

    def __init__(self, capacity: int, width: int, rng: np.random.Generator) -> None:
        rows, one, whole = (capacity, width), np.zeros(capacity, np.float32), np.zeros(capacity, np.int64)
        wide = np.zeros(rows, np.float32)
        self.content = Transitions(wide, whole, one, wide.copy(), one.copy())
        self.capacity, self.added, self._rng = capacity, 0, rng

    def __len__(self) -> int:
        """Return how many decisions are kept."""
        return min(self.added, self.capacity)

    def add(self, new: Transitions) -> None:
        """Keep new decisions."""
        where = (self.added + np.arange(len(new.action))) % self.capacity
        for kept, part in zip(self.content, new, strict=True):
            kept[where] = part
        self.added += len(new.action)

    def sample(self, count: int) -> list[Tensor]:
        """Return so many, each drawn from all."""
        where = self._rng.integers(0, len(self), count)
        return [torch.from_numpy(part[where]) for part in self.content]


class _Pending(NamedTuple):
    """A decision step whose rewards are still summed."""

    observation: np.ndarray  # (P, D)
    action: np.ndarray  # (P,)
    waits: np.ndarray  # (P,) bool: decided, and not complete
    reward: np.ndarray  # (P,)  so far


class Returns:
    """Sums the rewards of several steps before a decision goes into the replay (Sutton 1988).

    A decision of a person is complete after n steps, or when the person gets out.  Those of the last steps before an episode is
    cut off never are: what they led to is not known.
    """

    def __init__(self, n_steps: int, gamma: float) -> None:
        self.gamma = gamma
        self._steps: deque[_Pending] = deque(maxlen=n_steps)

    def add(
        self,
        observation: np.ndarray,
        action: np.ndarray,
        inside: np.ndarray,
        reward: np.ndarray,
        left: np.ndarray,
        cut: np.ndarray,
        after: np.ndarray,
    ) -> Transitions:
        """Take a step of all people (P,), those ``inside`` before it decided, and return the decisions it completes.

        Parameters
        ----------
        left, cut : who got out in it, or was still inside when the episode ended.
        after : (P, D) what is observed then.
        """
        self._steps.append(_Pending(observation, action, inside.copy(), np.zeros(len(action))))
        found: list[tuple[np.ndarray, ...]] = []
        for k, one in enumerate(self._steps):
            age = len(self._steps) - 1 - k
            one.reward[:] += self.gamma**age * np.where(one.waits, reward, 0.0)
            over = one.waits & left
            complete = one.waits & ~left & ~cut & (age + 1 == self._steps.maxlen)
            one.waits[left | cut] = False
            for rows, rest in ((over, 0.0), (complete, self.gamma ** (age + 1))):
                k_rows = np.flatnonzero(rows)
                if len(k_rows):
                    parts = one.observation[k_rows], one.action[k_rows], one.reward[k_rows], after[k_rows]
                    found.append((*parts, np.full(len(k_rows), rest)))
        if not found:
            nobody = np.flatnonzero(np.zeros(0))
            return Transitions(observation[nobody], action[nobody], np.zeros(0), after[nobody], np.zeros(0))
        return Transitions(*(np.concatenate(part) for part in zip(*found, strict=True)))


class RoomNoise:
    """A random change of the last layer for each room, of such a size that a given share of choices is another.

    Parameters
    ----------
    rooms, choices, width : E, A, and H units of the last layer but one.
    held : decision steps for which a room keeps it; rooms change one after the other.
    """

    def __init__(self, rooms: int, choices: int, width: int, held: int, rng: np.random.Generator) -> None:
        self.scale, self.held, self._rng = 0.1, held, rng
        self.change = rng.standard_normal((rooms, choices, width + 1)).astype(np.float32)
        self._age = np.arange(rooms) * held // rooms

    def choose(self, values: np.ndarray, features: np.ndarray, room: np.ndarray, share: float) -> np.ndarray:
        """Return choices (K,) of people with values (K, A) and features (K, H), each in a room; ``share`` is aimed at."""
        self._age += 1
        for e in np.flatnonzero(self._age >= self.held):
            self.change[e] = self._rng.standard_normal(self.change.shape[1:])
            self._age[e] = 0
        noise = np.empty_like(values)
        for e in range(len(self.change)):
            rows = room == e
            noise[rows] = features[rows] @ self.change[e, :, :-1].T + self.change[e, :, -1]
        chosen = (values + self.scale * noise).argmax(axis=1)
        other = (chosen != values.argmax(axis=1)).mean()
        self.scale *= _ADAPTS if other < share else 1.0 / _ADAPTS
        return np.asarray(chosen)


def train_dqn(env: CrowdEnv, settings: DQNSettings, seed: int, watch: Watch) -> None:
    """Train a network by double DQN (van Hasselt, Guez, Silver 2016) until ``watch`` says that it is enough.

    Parameters
    ----------
    env : made with ``autoreset=True`` and a discrete action; the network begins with the rule as the best choice.
    seed : of the network, the first episodes, and everything that is drawn.

    Raises
    ------
    ValueError
        If actions are not discrete.
    """
    space = env.single_action_space
    if not isinstance(space, gymnasium.spaces.Discrete):
        raise ValueError(f"action {env.action_kind.name!r} is not discrete; take one such as 'speeds'")
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rng, choices, width = np.random.default_rng(seed), int(space.n), settings.hidden
    body = nn.Sequential(nn.Linear(env.layout.size, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh())
    fast = nn.Sequential(*body, nn.Linear(width, choices))
    with torch.no_grad():
        fast[-1].weight *= 0.1
        fast[-1].bias.zero_()
        fast[-1].bias[int(np.asarray(env.action_kind.neutral))] = 0.2
    slow = copy.deepcopy(fast)
    optimizer = torch.optim.Adam(fast.parameters(), lr=settings.learning_rate)
    replay, returns = Replay(settings.capacity, env.layout.size, rng), Returns(settings.n_steps, settings.gamma)
    noise = RoomNoise(env.num_envs, choices, width, settings.held, rng)
    observation, _ = env.reset(seed)
    steps = 0
    while watch.goes_on(steps, lambda: LearnedPolicy(_plain(fast), env_options_of(env))):
        inside = env.active & env.learned
        rows = np.flatnonzero(inside)
        with torch.no_grad():
            features = fast[:-1](torch.from_numpy(observation[rows]))
            values = fast[-1](features)
        first, end = settings.explore
        share = first + (end - first) * min(watch.share / settings.explored, 1.0)
        action = np.zeros(env.num_people, dtype=np.int64)
        action[rows] = noise.choose(values.numpy(), features.numpy(), env.env_of_person[rows], share)
        step = env.step(action)
        ended = step.info.get("final_observation", step.observation)
        replay.add(returns.add(observation, action, inside, step.reward, step.terminated, step.truncated, ended))
        observation = step.observation
        steps += len(rows)
        if replay.added < settings.warm_up:
            continue
        for group in optimizer.param_groups:
            group["lr"] = settings.learning_rate * (1.0 - watch.share)
        update(fast, slow, replay.sample(settings.batch_size), optimizer, settings.target_rate)


def update(
    fast: nn.Module, slow: nn.Module, decisions: list[Tensor], optimizer: torch.optim.Optimizer, rate: float
) -> None:
    """Move the values of the fast network towards rewards and what the slow one expects, and the slow network after it."""
    observation, action, reward, after, discount = decisions
    with torch.no_grad():
        chosen = fast(after).argmax(dim=-1, keepdim=True)
        later = slow(after).gather(-1, chosen).squeeze(-1)
    value = fast(observation).gather(-1, action[:, None]).squeeze(-1)
    loss = nn.functional.smooth_l1_loss(value, reward + discount * later)
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(fast.parameters(), _LARGEST_GRADIENT)
    optimizer.step()
    with torch.no_grad():
        for behind, ahead in zip(slow.parameters(), fast.parameters(), strict=True):
            behind.lerp_(ahead, rate)


def _plain(network: nn.Sequential) -> MLP:
    """Return a copy as plain numbers."""
    layers = [layer for layer in network if isinstance(layer, nn.Linear)]
    weights, biases = ([getattr(one, name).detach().numpy().copy() for one in layers] for name in ("weight", "bias"))
    return MLP(tuple(weights), tuple(biases))
