"""The kinds of networks, by name."""

from agents.networks.mlp import MLP
from agents.networks.network import Network

# Kind, as files call it -> network.
NETWORKS: dict[str, type[Network]] = {MLP.kind: MLP}
