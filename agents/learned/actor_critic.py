"""The actor-critic policy of pedestrians and controllers: a critic that reads what the actor sees, nothing computed twice."""

from typing import ClassVar, Self

import gymnasium
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.distributions import CategoricalDistribution, DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor, nn
from torch.nn.functional import relu

from ..networks import MLP


class Layers(nn.Module):
    """Two layers of rectified units for actions; for values one layer on top of the first of these.

    The critic reads the first layer and does not change it: actions that were cloned stay as they are while it still knows
    nothing.  Its way back through the layers costs a third of that of a network of its own.

    Attributes
    ----------
    latent_dim_pi, latent_dim_vf : units of the last layers, as stable-baselines3 asks for them.
    """

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.latent_dim_pi = self.latent_dim_vf = hidden
        self.first, self.second = nn.Linear(inputs, hidden), nn.Linear(hidden, hidden)
        self.critic: nn.Module = nn.Linear(hidden, hidden)

    def forward(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return the last layers of actor and critic (K, H) for inputs (K, I)."""
        first = relu(self.first(rows))
        return relu(self.second(first)), relu(self.critic(first.detach()))

    def forward_actor(self, rows: Tensor) -> Tensor:
        """Return the last layer of the actor."""
        return relu(self.second(relu(self.first(rows))))

    def forward_critic(self, rows: Tensor) -> Tensor:
        """Return the last layer of the critic."""
        return self.forward(rows)[1]


class Choices(CategoricalDistribution):
    """A categorical distribution by its log probabilities alone: torch's own checks and normalises them thrice."""

    logits: Tensor  # (K, A)  normalised

    def proba_distribution(self, action_logits: Tensor) -> Self:
        """Take logits (K, A)."""
        self.logits = action_logits - action_logits.logsumexp(dim=1, keepdim=True)
        return self

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return the log probability (K,) of actions (K,)."""
        return self.logits.gather(1, actions.reshape(-1, 1)).squeeze(1)

    def entropy(self) -> Tensor:
        """Return the entropy (K,)."""
        return -(self.logits * self.logits.exp()).sum(dim=1)

    def sample(self) -> Tensor:
        """Return random actions (K,): the largest of logits with noise of a Gumbel distribution."""
        return (self.logits - torch.empty_like(self.logits).exponential_().log_()).argmax(dim=1)

    def mode(self) -> Tensor:
        """Return the likeliest actions (K,)."""
        return self.logits.argmax(dim=1)


class CrowdPolicy(ActorCriticPolicy):
    """An actor-critic policy on `Layers` of ``net_arch[0]`` units.

    Rows of zeros, of pedestrians who are out, are computed and drawn once for all.
    """

    mlp_extractor: Layers  # type: ignore[assignment]  # has what stable-baselines3 uses of its MlpExtractor
    kind: ClassVar[type[MLP]] = MLP
    activation: ClassVar[str] = "relu"

    def __init__(
        self,
        observation_space: gymnasium.Space,
        action_space: gymnasium.Space,
        lr_schedule: Schedule,
        **options: object,
    ) -> None:
        super().__init__(observation_space, action_space, lr_schedule, **options)  # type: ignore[arg-type]  # as PPO has them
        if isinstance(self.action_dist, CategoricalDistribution):
            self.action_dist = Choices(self.action_dist.action_dim)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = Layers(self.features_dim, self.net_arch[0])  # type: ignore[index,arg-type]  # a list here

    def forward(self, obs: Tensor, deterministic: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        """Return actions (K, ...), values (K, 1) and log probabilities (K,) for observations (K, D)."""
        where = obs.any(dim=1).nonzero().squeeze(1)
        row = torch.full((len(obs),), len(where))
        row[where] = torch.arange(len(where))
        found = super().forward(torch.cat([obs[where], obs.new_zeros(1, obs.shape[1])]), deterministic)
        return found[0][row], found[1][row], found[2][row]


def network_of(model: PPO) -> MLP:
    """Return the actor of a model as plain numbers: what it does without drawing actions at random.

    Raises
    ------
    ValueError
        If its policy is another than a `CrowdPolicy` on flat observations.
    """
    policy = model.policy
    if not isinstance(policy, CrowdPolicy) or not isinstance(policy.pi_features_extractor, FlattenExtractor):
        raise ValueError(f"its network is no {CrowdPolicy.__name__} on flat observations")
    layers = [policy.mlp_extractor.first, policy.mlp_extractor.second, policy.action_net]
    weights, biases = (
        tuple(getattr(one, name).detach().cpu().numpy() for one in layers) for name in ("weight", "bias")
    )
    return policy.kind(weights, biases, policy.activation)


def std_of(model: PPO) -> list[float] | None:
    """Return the standard deviations of the components of a Gaussian action; None of another distribution."""
    if not isinstance(model.policy.action_dist, DiagGaussianDistribution):
        return None
    return [float(one) for one in model.policy.log_std.detach().exp()]
