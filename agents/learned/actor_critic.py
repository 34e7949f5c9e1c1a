"""The actor-critic policy of pedestrians and controllers: two layers of its own for each."""

from typing import ClassVar, Self

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
    """Two layers of rectified units for the actor, and two for the critic.

    Cloned actions stay as they are while the critic is untrained.  A critic on top of the first layer of the actor costs a
    tenth less, and ends a second and a half later in the task "narrow-door".

    Attributes
    ----------
    latent_dim_pi, latent_dim_vf : units of the last layers, as stable-baselines3 requires them.
    """

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.latent_dim_pi = self.latent_dim_vf = hidden
        self.first, self.second = nn.Linear(inputs, hidden), nn.Linear(hidden, hidden)
        self.critic: nn.Module = nn.Sequential(
            nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU()
        )

    def forward(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return the last layers of actor and critic (K, H) for inputs (K, I)."""
        return self.forward_actor(rows), self.critic(rows)

    def forward_actor(self, rows: Tensor) -> Tensor:
        """Return the last layer of the actor."""
        return relu(self.second(relu(self.first(rows))))

    def forward_critic(self, rows: Tensor) -> Tensor:
        """Return the last layer of the critic."""
        return self.critic(rows)


class Choices(CategoricalDistribution):
    """A categorical distribution by its log probabilities; torch's own checks and normalizes them three times."""

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
        """Return random actions (K,): the largest logits plus Gumbel noise."""
        return (self.logits - torch.empty_like(self.logits).exponential_().log_()).argmax(dim=1)

    def mode(self) -> Tensor:
        """Return the most likely actions (K,)."""
        return self.logits.argmax(dim=1)


class CrowdPolicy(ActorCriticPolicy):
    """An actor-critic policy on `Layers` of ``net_arch[0]`` units.

    Rows of zeros, of pedestrians outside, share one computation and one draw.
    """

    mlp_extractor: Layers  # type: ignore[assignment]  # has the attributes of MlpExtractor that stable-baselines3 uses
    kind: ClassVar[type[MLP]] = MLP
    activation: ClassVar[str] = "relu"

    def _build(self, lr_schedule: Schedule) -> None:
        if isinstance(self.action_dist, CategoricalDistribution):
            self.action_dist = Choices(self.action_dist.action_dim)
        super()._build(lr_schedule)

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
    """Return the actor of a model as plain numbers, with its most likely actions.

    Raises
    ------
    ValueError
        If its policy is neither a `CrowdPolicy` nor an ``MlpPolicy`` of tanh or ReLU, on flat observations.
    """
    policy, kind, hidden = model.policy, MLP, list[nn.Module]()
    if not isinstance(policy, ActorCriticPolicy) or not isinstance(policy.pi_features_extractor, FlattenExtractor):
        raise ValueError("its network is no actor and critic on flat observations")
    activation = {nn.Tanh: "tanh", nn.ReLU: "relu"}.get(policy.activation_fn)
    if isinstance(policy, CrowdPolicy):
        kind, activation = policy.kind, policy.activation
        hidden = [policy.mlp_extractor.first, policy.mlp_extractor.second]
    elif type(policy) is ActorCriticPolicy:
        hidden = [one for one in policy.mlp_extractor.policy_net if isinstance(one, nn.Linear)]
    if not hidden or activation is None:
        raise ValueError(f"its network is no {CrowdPolicy.__name__}, and no MlpPolicy of tanh or ReLU")
    layers = *hidden, policy.action_net
    weights, biases = ([getattr(one, name).detach().cpu().numpy() for one in layers] for name in ("weight", "bias"))
    return kind(tuple(weights), tuple(biases), activation)


def std_of(model: PPO) -> list[float] | None:
    """Return the standard deviations of the components of a Gaussian action; None for another distribution."""
    if not isinstance(model.policy.action_dist, DiagGaussianDistribution):
        return None
    return [float(one) for one in model.policy.log_std.detach().exp()]
