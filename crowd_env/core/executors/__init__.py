"""Where pieces of work are done: one after the other here, in processes of this machine, on the nodes of a Ray cluster.

The result of a piece depends on the piece alone, so all executors bring about the same.
"""

from collections.abc import Callable, Mapping
from typing import Any

from crowd_env.core.checks import known
from crowd_env.core.executors.cluster import RayCluster, check_cluster
from crowd_env.core.executors.executor import Executor, Processes, Serial, WorkerDied, all_cores

__all__ = [
    "EXECUTORS",
    "Executor",
    "Processes",
    "RayCluster",
    "Serial",
    "WorkerDied",
    "all_cores",
    "check_cluster",
    "make_executor",
]

EXECUTORS: Mapping[str, Callable[..., Executor]] = {"serial": Serial, "processes": Processes, "ray": RayCluster}


def make_executor(name: str, **options: Any) -> Executor:
    """Return the executor of this name; ``options`` are its parameters.

    Raises
    ------
    ValueError
        If the name is unknown, or the cluster cannot be reached.
    ModuleNotFoundError
        If its library is not installed; the message says how to install it.
    """
    return EXECUTORS[known("executor", name, EXECUTORS)](**options)
