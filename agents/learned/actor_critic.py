"""PPO of a shared policy over scenes of people, with any actor and critic: what MAPPO and the variant with attention train.

`crowd_env.agents.learned.ppo` is PPO by stable-baselines3, whose critic sees what the actor sees.  Here the critic
may see everyone.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from crowd_env import CrowdEnv

from ..trained import LearnedPolicy
from .batch import Decided, SceneBatch
from .export import plain
from .networks import AttentionCritic, CentralCritic, NeighborAttention, layers
from .ppo import PPOSettings
from .training import env_options_of
from .watch import Watch

_VALUE_WEIGHT, _LARGEST_GRADIENT = 0.5, 0.5


class Networks(NamedTuple):
    """What is trained."""

    actor: nn.Module  # observations (..., D) -> logits (..., A)
    critic: nn.Module  # observations (..., N, D) and states (..., N, F) -> values (..., N)


class Rollout(NamedTuple):
    """T decision steps of E scenes of N people, or some scenes of them, flat."""

    observation: Tensor  # (T, E, N, D)  before the step
    state: Tensor  # (T, E, N, F)
    inside: Tensor  # (T, E, N) bool: who decides
    action: Tensor  # (T, E, N)
    log_prob: Tensor  # (T, E, N)
    advantage: Tensor  # (T, E, N)
    target: Tensor  # (T, E, N)  of the values


def central(batch: SceneBatch, settings: PPOSettings) -> Networks:
    """Return the networks of MAPPO: a policy of one's own observation, a critic of everyone's state (Yu et al. 2022)."""
    inputs, hidden = batch.env.layout.size, settings.hidden
    critic = CentralCritic(inputs, batch.now.state.shape[-1], hidden)
    return Networks(layers(inputs, hidden, hidden, batch.choices, last_gain=0.01), critic)


def attention(batch: SceneBatch, settings: PPOSettings) -> Networks:
    """Return a policy and a critic that attend to the neighbors."""
    layout, hidden = batch.env.layout, settings.hidden
    return Networks(NeighborAttention(layout, batch.choices, hidden, last_gain=0.01), AttentionCritic(layout, hidden))


def train_actor_critic(
    env: CrowdEnv,
    settings: PPOSettings,
    seed: int,
    watch: Watch,
    make: Callable[[SceneBatch, PPOSettings], Networks],
) -> None:
    """Train a policy by PPO (Schulman et al. 2017) until ``watch`` says that it is enough.

    To get out ends what a person earns, as far as returns go: a ``team_share`` of later steps is not counted.  Who is cut off
    by the end of an episode is taken to go on earning what the last decision was worth.

    Parameters
    ----------
    env : made with ``autoreset=True`` and a discrete action; everyone begins with the rule as the likeliest choice.
    seed : of the networks, the first episodes, and the actions that are drawn.

    Raises
    ------
    ValueError
        If the environment does not suit, see `SceneBatch`.
    """
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    batch = SceneBatch(env, seed, with_state=make is central)
    networks = make(batch, settings)
    with torch.no_grad():
        last = [one for one in networks.actor.modules() if isinstance(one, nn.Linear)][-1]
        last.bias[batch.rule] += settings.rule_logit
    parameters = [*networks.actor.parameters(), *networks.critic.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=settings.learning_rate, eps=1e-5)
    steps = 0
    while watch.goes_on(steps, lambda: LearnedPolicy(plain(networks.actor), env_options_of(env))):
        for group in optimizer.param_groups:
            group["lr"] = settings.learning_rate * (1.0 - watch.share)
        rollout = collect(batch, networks, settings)
        steps += int(rollout.inside.sum())
        update(rollout, networks, optimizer, settings)


@torch.no_grad()
def collect(batch: SceneBatch, networks: Networks, settings: PPOSettings) -> Rollout:
    """Return the next steps of all scenes, under actions that are drawn from the policy."""
    rows: list[tuple[Tensor, ...]] = []
    steps: list[tuple[Decided, Tensor]] = []
    for _ in range(settings.n_steps):
        now = batch.now
        choice = torch.distributions.Categorical(logits=networks.actor(now.observation))
        action = choice.sample()
        value = networks.critic(now.observation, now.state)
        rows.append((now.observation, now.state, now.inside, action, choice.log_prob(action)))
        steps.append((batch.step(action), value))
    value = networks.critic(batch.now.observation, batch.now.state)
    advantage, chain = torch.zeros_like(value), torch.zeros_like(value)
    advantages, targets = [], []
    for (after, own), (_, _, inside, _, _) in zip(reversed(steps), reversed(rows), strict=True):
        later = torch.where(after.cut, own, value).masked_fill(after.left, 0.0)
        error = after.reward + settings.gamma * later - own
        going = inside & ~after.left & ~after.cut
        advantage = torch.where(inside, error + settings.gamma * settings.gae_lambda * going * chain, 0.0)
        advantages.append(advantage)
        targets.append(advantage + own)
        chain, value = advantage, own
    parts = [torch.stack(part) for part in zip(*rows, strict=True)]
    return Rollout._make([*parts, torch.stack(advantages[::-1]), torch.stack(targets[::-1])])


def update(rollout: Rollout, networks: Networks, optimizer: torch.optim.Optimizer, settings: PPOSettings) -> None:
    """Improve actor and critic on a rollout, scene by scene, so that a critic may look at all people of one."""
    flat = Rollout(*(part.flatten(0, 1) for part in rollout))
    flat = Rollout(*(part[flat.inside.any(dim=1)] for part in flat))
    scenes = len(flat.inside)
    parts = max(1, round(int(flat.inside.sum()) / settings.batch_size))
    for _ in range(settings.n_epochs):
        for chosen in np.array_split(torch.randperm(scenes).numpy(), parts):
            scene = Rollout(*(part[torch.from_numpy(chosen)] for part in flat))
            loss, divergence = losses(scene, networks, settings)
            if divergence > 1.5 * settings.target_kl:
                return
            optimizer.zero_grad()
            loss.backward()
            for network in networks:
                nn.utils.clip_grad_norm_(network.parameters(), _LARGEST_GRADIENT)
            optimizer.step()


def losses(scene: Rollout, networks: Networks, settings: PPOSettings) -> tuple[Tensor, float]:
    """Return the loss of PPO over those who decided, and how far the policy has moved (approximate KL divergence)."""
    inside = scene.inside
    choice = torch.distributions.Categorical(logits=networks.actor(scene.observation[inside]))
    moved = choice.log_prob(scene.action[inside]) - scene.log_prob[inside]
    ratio, advantage = moved.exp(), scene.advantage[inside]
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    clipped = ratio.clamp(1.0 - settings.clip_range, 1.0 + settings.clip_range)
    policy = -torch.min(ratio * advantage, clipped * advantage).mean()
    value = networks.critic(scene.observation, scene.state)[inside]
    error = nn.functional.mse_loss(value, scene.target[inside])
    loss = policy + _VALUE_WEIGHT * error - settings.ent_coef * choice.entropy().mean()
    return loss, float((ratio.detach() - 1.0 - moved.detach()).mean())
