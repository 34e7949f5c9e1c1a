"""The kinds of networks, by name."""

from .attention import Attention
from .beta import BetaMLP
from .mlp import MLP
from .network import Network

# Kind, as files call it -> network.
NETWORKS: dict[str, type[Network]] = {one.kind: one for one in (MLP, BetaMLP, Attention)}
