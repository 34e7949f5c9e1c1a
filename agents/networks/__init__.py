"""Networks as plain numbers: used, written and read with numpy alone, so that opening one runs nobody's code."""

from .attention import Attention
from .beta import BetaMLP
from .file import network_digest, read_network, write_network
from .mlp import MLP
from .network import Network
from .registry import NETWORKS

NETWORK = "best.safetensors"  # file in the folder of a training

__all__ = [
    "MLP",
    "NETWORK",
    "NETWORKS",
    "Attention",
    "BetaMLP",
    "Network",
    "network_digest",
    "read_network",
    "write_network",
]
