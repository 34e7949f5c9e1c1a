"""The kinds of networks, by name."""

from agents.networks.attention import Attention
from agents.networks.beta import BetaMLP
from agents.networks.mlp import MLP
from agents.networks.network import Network

# Kind, as files call it -> network.
NETWORKS: dict[str, type[Network]] = {one.kind: one for one in (MLP, BetaMLP, Attention)}
