"""Networks as plain numbers: used, written and read with NumPy alone, so that opening a file executes nothing from it."""

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
