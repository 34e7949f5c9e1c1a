"""Double DQN of one network for everybody: independent Q-learning with shared parameters, over a discrete action."""

import copy
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from crowd_env import CrowdEnv

from ..trained import LearnedPolicy
from .batch import Decided, SceneBatch
from .export import plain
from .networks import layers
from .training import env_options_of
from .watch import Watch

_LARGEST_GRADIENT = 1.0


@dataclass(frozen=True)
class DQNSettings:
    """Hyperparameters, a line each."""

    learning_rate: float = 1e-3  # falls linearly to zero over the budget
    gamma: float = 0.98  # per decision step of 0.1 s
    n_steps: int = 5  # decision steps whose rewards are summed before a value is asked for
    capacity: int = 400_000  # decisions that are remembered
    batch_size: int = 4096
    updates: int = 2  # after every decision step of the batch
    warm_up: int = 20_000  # decisions before the first update
    explore: tuple[float, float] = (0.5, 0.02)  # share of random choices: at first, and from then on when ...
    explored: float = 0.6  # ... this share of the budget is spent
    target_rate: float = 0.005  # of the way from the slow to the fast network, in every update
    hidden: int = 64  # units in each of two layers


class Transitions(NamedTuple):
    """K decisions and what came of them."""

    observation: Tensor  # (K, D)
    action: Tensor  # (K,)
    reward: Tensor  # (K,)  discounted, of the steps until ...
    after: Tensor  # (K, D)  ... this was observed
    discount: Tensor  # (K,)  of what comes then; 0 for those who got out


class Replay:
    """The last decisions of people who were inside; slots of those who have left never come in.

    Parameters
    ----------
    capacity : how many are kept; new ones replace the oldest.
    width : columns D of an observation.
    """

    def __init__(self, capacity: int, width: int) -> None:
        self.content = Transitions(
            torch.zeros(capacity, width),
            torch.zeros(capacity, dtype=torch.int64),
            torch.zeros(capacity),
            torch.zeros(capacity, width),
            torch.zeros(capacity),
        )
        self.capacity, self.added = capacity, 0

    def __len__(self) -> int:
        """Return how many decisions are kept."""
        return min(self.added, self.capacity)

    def add(self, new: Transitions) -> None:
        """Keep new decisions."""
        where = (self.added + torch.arange(len(new.action))) % self.capacity
        for kept, part in zip(self.content, new, strict=True):
            kept[where] = part
        self.added += len(new.action)

    def sample(self, count: int) -> Transitions:
        """Return so many, each drawn from all."""
        where = torch.randint(len(self), (count,))
        return Transitions(*(part[where] for part in self.content))


class Returns:
    """Sums the rewards of several steps before a decision goes into the replay (Sutton 1988).

    A decision of a person is complete after ``n_steps``, or when the person gets out.  Those of the last steps before an
    episode is cut off never are: what they led to is not known.
    """

    def __init__(self, settings: DQNSettings) -> None:
        self.gamma = settings.gamma
        self._steps: deque[tuple[Decided, Tensor, Decided]] = deque(maxlen=settings.n_steps)

    def add(self, before: Decided, action: Tensor, after: Decided) -> list[Transitions]:
        """Take a step of all scenes, and return the decisions that are complete with it."""
        self._steps.append((before, action, after))
        found = [self._decisions(k, after.left, 0.0) for k in range(len(self._steps))]
        if len(self._steps) == self._steps.maxlen:
            found.append(self._decisions(0, ~after.left & ~after.cut, self.gamma ** len(self._steps)))
        return found

    def _decisions(self, k: int, chosen: Tensor, discount: float) -> Transitions:
        """Return the decisions in step ``k`` of those ``chosen`` (E, N) who were inside until the last step."""
        before, action, _ = self._steps[k]
        last, _, after = self._steps[-1]
        who = chosen & last.inside & (before.episode == last.episode)
        rewards = [self.gamma**m * step[2].reward[who] for m, step in enumerate(list(self._steps)[k:])]
        rest = torch.full((int(who.sum()),), discount)
        return Transitions(before.observation[who], action[who], sum(rewards, 0.0 * rest), after.observation[who], rest)


def train_dqn(env: CrowdEnv, settings: DQNSettings, seed: int, watch: Watch) -> None:
    """Train a network by double DQN (van Hasselt, Guez, Silver 2016) until ``watch`` says that it is enough.

    Random choices are drawn evenly from all, and the network begins with the rule as the best choice.

    Parameters
    ----------
    env : made with ``autoreset=True`` and a discrete action.
    seed : of the network, the first episodes, and everything that is drawn.

    Raises
    ------
    ValueError
        If the environment does not suit, see `SceneBatch`.
    """
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    batch = SceneBatch(env, seed)
    fast = layers(env.layout.size, settings.hidden, settings.hidden, batch.choices, last_gain=0.01)
    with torch.no_grad():
        last = [one for one in fast.modules() if isinstance(one, nn.Linear)][-1]
        last.bias[batch.rule] += 0.1
    slow = copy.deepcopy(fast)
    optimizer = torch.optim.Adam(fast.parameters(), lr=settings.learning_rate)
    replay, returns = Replay(settings.capacity, env.layout.size), Returns(settings)
    steps = 0
    while watch.goes_on(steps, lambda: LearnedPolicy(plain(fast), env_options_of(env))):
        before = batch.now
        first, end = settings.explore
        random = first + (end - first) * min(watch.share / settings.explored, 1.0)
        with torch.no_grad():
            best = fast(before.observation).argmax(dim=-1)
        drawn = torch.randint(batch.choices, batch.shape)
        action = torch.where(torch.rand(batch.shape) < random, drawn, best)
        for complete in returns.add(before, action, batch.step(action)):
            replay.add(complete)
        steps += int(before.inside.sum())
        if replay.added < settings.warm_up:
            continue
        for group in optimizer.param_groups:
            group["lr"] = settings.learning_rate * (1.0 - watch.share)
        for _ in range(settings.updates):
            update(fast, slow, replay.sample(settings.batch_size), optimizer, settings.target_rate)


def update(
    fast: nn.Module, slow: nn.Module, decisions: Transitions, optimizer: torch.optim.Optimizer, rate: float
) -> None:
    """Move the values of the fast network towards rewards and what the slow one expects, and the slow network after it."""
    with torch.no_grad():
        chosen = fast(decisions.after).argmax(dim=-1, keepdim=True)
        later = slow(decisions.after).gather(-1, chosen).squeeze(-1)
    value = fast(decisions.observation).gather(-1, decisions.action[:, None]).squeeze(-1)
    loss = nn.functional.smooth_l1_loss(value, decisions.reward + decisions.discount * later)
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(fast.parameters(), _LARGEST_GRADIENT)
    optimizer.step()
    with torch.no_grad():
        for behind, ahead in zip(slow.parameters(), fast.parameters(), strict=True):
            behind.lerp_(ahead, rate)
