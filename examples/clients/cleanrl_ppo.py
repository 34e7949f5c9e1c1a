"""PPO in one file, in the manner of CleanRL: python examples/clients/cleanrl_ppo.py --steps 800000

All that PPO needs stands here, to be read from top to bottom and to be changed.  One network is shared by everybody, and the
rooms are stepped as arrays (`CrowdEnv`): a row is the slot of one pedestrian.  What differs from PPO for a single agent is the
mask: once a pedestrian has left, the row is nobody's until the room starts anew, and does not belong in the loss.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import torch
import typer
from torch import nn
from torch.distributions import Categorical

from crowd_env import CrowdEnv

# 30 people and a door that passes one at a time: if everybody presses, they block it; who waits for a turn gets out sooner.
ROOM = {
    "scenario": {"name": "room-v0", "door_width": 0.6},
    "people": 30,
    "time_limit": 40.0,
    "action": "speeds",  # a choice among five speeds along the way out
    "reward": {"weights": {"progress": 0.5, "time": 1.0, "contact": 1.0}},
}


@dataclass(frozen=True)
class Settings:
    rooms: int = 16
    rollout: int = 64  # decision steps between two updates
    learning_rate: float = 1e-3
    gamma: float = 0.98  # per decision step of 0.1 s
    gae_lambda: float = 0.9
    epochs: int = 4
    minibatch: int = 2048
    clip: float = 0.2
    entropy: float = 0.003
    value: float = 0.5


class Rollout(NamedTuple):
    """T decision steps of P slots; the rows where ``acted`` is false are nobody's."""

    observation: np.ndarray  # (T, P, D)
    action: np.ndarray  # (T, P)
    log_prob: np.ndarray  # (T, P)
    value: np.ndarray  # (T, P)
    reward: np.ndarray  # (T, P)  with the value of what was cut off at the time limit
    done: np.ndarray  # (T, P)  got out, or cut off: nothing later belongs to this action
    acted: np.ndarray  # (T, P)  inside when the step began
    last_value: np.ndarray  # (P,)


class Agent(nn.Module):
    """Logits of the choices, and the value; at first "full speed along the way out" is the likeliest choice."""

    def __init__(self, env: CrowdEnv) -> None:
        super().__init__()
        size = env.layout.size
        self.actor = nn.Sequential(nn.Linear(size, 64), nn.Tanh(), nn.Linear(64, int(env.single_action_space.n)))
        self.critic = nn.Sequential(nn.Linear(size, 64), nn.Tanh(), nn.Linear(64, 1))
        with torch.no_grad():
            self.actor[-1].weight *= 0.01
            self.actor[-1].bias[env.action_kind.neutral] += 2.0

    def values(self, observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return self.critic(torch.as_tensor(observation)).squeeze(-1).numpy()

    def act(self, observation: np.ndarray, greedy: bool = False) -> tuple[np.ndarray, np.ndarray]:
        with torch.no_grad():
            choices = Categorical(logits=self.actor(torch.as_tensor(observation)))
            action = choices.logits.argmax(-1) if greedy else choices.sample()
            return action.numpy(), choices.log_prob(action).numpy()


def collect(env: CrowdEnv, agent: Agent, observation: np.ndarray, settings: Settings) -> tuple[Rollout, np.ndarray]:
    """Walk on from an observation; return the rollout and the observation it ends with."""
    rows = []
    for _ in range(settings.rollout):
        acted = env.active.copy()
        action, log_prob = agent.act(observation)
        step = env.step(action)
        reward = step.reward.copy()
        if step.truncated.any():  # the time limit cut these off: their future is worth what the critic says of it
            cut = step.truncated
            reward[cut] += settings.gamma * agent.values(step.info["final_observation"][cut])
        done = step.terminated | step.truncated
        rows.append((observation, action, log_prob, agent.values(observation), reward, done, acted))
        observation = step.observation  # where a room has ended, the first one of its next episode
    return Rollout(*(np.stack(column) for column in zip(*rows, strict=True)), agent.values(observation)), observation


def advantages(rollout: Rollout, gamma: float, gae_lambda: float) -> np.ndarray:
    """Return generalized advantages (T, P).  A slot's next life cannot leak into the last one: ``done`` lies between."""
    advantage, later, value_after = np.zeros_like(rollout.reward), 0.0, rollout.last_value
    for t in reversed(range(len(advantage))):
        goes_on = ~rollout.done[t]
        delta = rollout.reward[t] + gamma * goes_on * value_after - rollout.value[t]
        advantage[t] = later = delta + gamma * gae_lambda * goes_on * later
        value_after = rollout.value[t]
    return advantage


def update(agent: Agent, optimizer: torch.optim.Optimizer, rollout: Rollout, settings: Settings) -> int:
    """Improve the agent by a rollout; return how many samples it held."""
    advantage = advantages(rollout, settings.gamma, settings.gae_lambda)
    here = rollout.acted  # the mask: who has left teaches nothing
    columns = (rollout.observation, rollout.action, rollout.log_prob, advantage, advantage + rollout.value)
    dtypes = (torch.float32, torch.int64, *[torch.float32] * 3)
    observation, action, old, advantage, target = (
        torch.as_tensor(column[here], dtype=dtype) for column, dtype in zip(columns, dtypes, strict=True)
    )
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    for _ in range(settings.epochs):
        for part in torch.randperm(len(old)).split(settings.minibatch):
            choices = Categorical(logits=agent.actor(observation[part]))
            ratio = (choices.log_prob(action[part]) - old[part]).exp()
            gain = torch.min(
                ratio * advantage[part], ratio.clamp(1 - settings.clip, 1 + settings.clip) * advantage[part]
            )
            error = (agent.critic(observation[part]).squeeze(-1) - target[part]) ** 2
            loss = -gain.mean() + settings.value * error.mean() - settings.entropy * choices.entropy().mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()
    return len(old)


def judge(agent: Agent | None, draws: int = 20) -> str:
    """Return how an agent does in rooms not seen in training; without one everybody walks the shortest path at full speed."""
    env = CrowdEnv(**ROOM, num_envs=draws)
    observation, _ = env.reset(seed=list(range(1_000_000, 1_000_000 + draws)))
    seconds = 0.0
    while not env.finished.all():
        seconds += env.active.mean() * env.decision_dt
        observation = env.step(None if agent is None else agent.act(observation, greedy=True)[0]).observation
    stuck = sum(env.metrics(e).unfinished for e in range(draws))
    return f"{seconds:.2f} s inside per person, {stuck} of {env.num_people} people still inside at the end"


def main(steps: Annotated[int, typer.Option(min=1)] = 800_000, seed: Annotated[int, typer.Option(min=0)] = 0) -> Agent:
    """Train for this many decisions of single pedestrians."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # for networks this small a second thread costs more than it brings
    settings = Settings()
    env = CrowdEnv(**ROOM, num_envs=settings.rooms, autoreset=True)
    agent = Agent(env)
    optimizer = torch.optim.Adam(agent.parameters(), lr=settings.learning_rate)
    observation, _ = env.reset(seed=seed)
    taken = updates = 0
    while taken < steps:
        rollout, observation = collect(env, agent, observation, settings)
        taken += update(agent, optimizer, rollout, settings)
        updates += 1
        if updates % 5 == 0 or taken >= steps:
            print(f"{taken:8d} decisions, mean reward {rollout.reward[rollout.acted].mean():.4f}")
    print(f"rule:    {judge(None)}\nlearned: {judge(agent)}")
    return agent


if __name__ == "__main__":
    typer.run(main)
