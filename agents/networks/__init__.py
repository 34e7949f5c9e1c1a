"""Networks as plain numbers: used, written and read with numpy alone, so that opening one runs nobody's code."""

from agents.networks.attention import Attention
from agents.networks.beta import BetaMLP
from agents.networks.file import network_digest, read_network, write_network
from agents.networks.mlp import MLP
from agents.networks.network import Network
from agents.networks.registry import NETWORKS

__all__ = ["MLP", "NETWORKS", "Attention", "BetaMLP", "Network", "network_digest", "read_network", "write_network"]
