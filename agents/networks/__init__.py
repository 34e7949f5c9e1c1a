"""Networks as plain numbers: used, written and read with numpy alone, so that opening one runs no foreign code."""

from .file import NETWORK, NETWORKS, network_digest, read_network, write_network
from .network import MLP, BetaMLP, BetweenMLP, Network

__all__ = [
    "MLP",
    "NETWORK",
    "NETWORKS",
    "BetaMLP",
    "BetweenMLP",
    "Network",
    "network_digest",
    "read_network",
    "write_network",
]
