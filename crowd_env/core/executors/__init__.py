"""Where pieces of work are done: one after the other here, in processes of this machine, on the nodes of a Ray cluster.

The result of a piece depends on the piece alone, so all executors bring about the same.
"""

from crowd_env.core.executors.cluster import RayCluster, check_cluster
from crowd_env.core.executors.executor import Executor, Processes, Serial, WorkerDied, all_cores

__all__ = ["Executor", "Processes", "RayCluster", "Serial", "WorkerDied", "all_cores", "check_cluster"]
