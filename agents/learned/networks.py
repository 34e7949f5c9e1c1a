"""Networks of shared policies and their critics, over scenes (..., N, D) of N people: torch modules, a few layers each."""

import math
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from crowd_env import ObservationLayout


def layers(*sizes: int, last_gain: float = 1.0) -> nn.Sequential:
    """Return linear layers of these sizes with tanh between them, orthogonal weights and zero biases.

    Parameters
    ----------
    last_gain : of the weights of the last layer: 0.01 lets a policy begin at its bias.
    """
    found: list[nn.Module] = []
    for k, (inputs, outputs) in enumerate(pairwise(sizes)):
        linear = nn.Linear(inputs, outputs)
        last = k == len(sizes) - 2
        nn.init.orthogonal_(linear.weight, last_gain if last else math.sqrt(2.0))
        nn.init.zeros_(linear.bias)
        found += [linear] if last else [linear, nn.Tanh()]
    return nn.Sequential(*found)


class CentralCritic(nn.Module):
    """What a person's observation is worth, given the state of everyone in the scene (Yu et al. 2022, MAPPO).

    The rows of the people are turned into features, which are averaged over those inside: in any order and for any number of
    people they come to one vector of the same length (Zaheer et al. 2017, deep sets).
    """

    def __init__(self, inputs: int, state: int, hidden: int) -> None:
        super().__init__()
        self.person = nn.Sequential(layers(state, hidden, hidden), nn.Tanh())
        self.value = layers(inputs + hidden + 1, hidden, hidden, 1)

    def forward(self, observation: Tensor, state: Tensor) -> Tensor:
        """Return values (..., N) of observations (..., N, D) and states (..., N, F), whose last column says who is inside."""
        inside = state[..., -1:]
        count = inside.sum(dim=-2, keepdim=True)
        pooled = (inside * self.person(state)).sum(dim=-2, keepdim=True) / count.clamp(min=1.0)
        share = count / state.shape[-2]
        crowd = torch.cat([pooled, share], dim=-1).expand(*observation.shape[:-1], -1)
        return self.value(torch.cat([observation, crowd], dim=-1)).squeeze(-1)


class NeighborAttention(nn.Module):
    """Attention of a person over the neighbors that are observed (Vaswani et al. 2017, one head), then layers of tanh units.

    The number of neighbors does not matter to it, nor their order.

    Parameters
    ----------
    layout : of the observation; it must have the term ``neighbors`` and may have ``lead``.
    outputs : of the network.
    hidden : units in each layer, and of queries, keys and values.
    last_gain : of the weights of the last layer.

    Raises
    ------
    ValueError
        If neighbors are not observed.
    """

    def __init__(self, layout: ObservationLayout, outputs: int, hidden: int, last_gain: float = 1.0) -> None:
        super().__init__()
        if "neighbors" not in layout.names:
            raise ValueError("attention over neighbors needs the term 'neighbors' in the observation")
        self.count = layout.neighbors
        self.with_lead = "lead" in layout.names
        self.neighbors, self.lead = layout["neighbors"], layout["lead"] if self.with_lead else slice(0, 0)
        of_others = [*range(*self.neighbors.indices(layout.size)), *range(*self.lead.indices(layout.size))]
        self.own = np.setdiff1d(np.arange(layout.size), of_others).tolist()
        columns = 5 + self.with_lead
        self.query, self.token = layers(len(self.own), hidden, hidden), layers(columns, hidden, 2 * hidden)
        self.out = layers(len(self.own) + hidden, hidden, outputs, last_gain=last_gain)

    def forward(self, observation: Tensor) -> Tensor:
        """Return the outputs (..., outputs) of observations (..., D)."""
        others = observation[..., self.neighbors].unflatten(-1, (self.count, 5))
        there = (others != 0.0).any(dim=-1)  # rows of zeros are nobody
        if self.with_lead:
            others = torch.cat([others, observation[..., self.lead].unsqueeze(-1)], dim=-1)
        own = observation[..., self.own]
        key, value = self.token(others).chunk(2, dim=-1)
        score = (key * self.query(own).unsqueeze(-2)).sum(dim=-1) / math.sqrt(key.shape[-1])
        weight = score.masked_fill(~there, -1e9).softmax(dim=-1) * there
        seen = (weight.unsqueeze(-1) * value).sum(dim=-2)
        return self.out(torch.cat([own, seen], dim=-1))


class AttentionCritic(nn.Module):
    """What a person's own observation is worth, by attention over the neighbors."""

    def __init__(self, layout: ObservationLayout, hidden: int) -> None:
        super().__init__()
        self.value = NeighborAttention(layout, 1, hidden)

    def forward(self, observation: Tensor, state: Tensor) -> Tensor:
        """Return values (..., N) of observations (..., N, D); the state of everyone is not looked at."""
        return self.value(observation).squeeze(-1)
