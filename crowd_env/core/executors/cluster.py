"""Pieces of work on the nodes of a Ray cluster; the only file of the simulator that knows Ray, which it loads on first use.

Ray starts a process for each core of each node, hands it pieces, and repeats a piece elsewhere if its process or node
has died.  A node needs the same code at hand: each piece carries a stamp of it, which the node compares with its own.
"""

import importlib
import os
import pickle
import signal
import socket
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.executors.executor import Done, Outcome, Piece, Work, WorkerDied, never
from crowd_env.core.kernels.jit import source_stamp
from crowd_env.core.libraries import needed_for

RETRIES = 3  # of a piece after its process or node has died; a piece that kills every process is given up
_LOOK = 0.5  # s  between two looks for Ctrl-C
_REACHED = 10.0  # s  within which a cluster has to answer


class RayCluster:
    """Does pieces on a Ray cluster: that at ``RAY_ADDRESS``, else one that runs on this machine, else one that is begun here.

    Parameters
    ----------
    cores : that a piece takes.

    Raises
    ------
    ValueError
        If the cluster cannot be reached, or no node of it has ``cores`` cores.
    ModuleNotFoundError
        If Ray is not installed; the message explains how to install it.
    """

    apart = True

    def __init__(self, cores: int = 1) -> None:
        self.cores, self._ray = cores, load_ray()
        self._began = _begin(self._ray)
        sizes = [int(node["Resources"].get("CPU", 0)) for node in self._ray.nodes() if node["Alive"]]
        if max(sizes, default=0) < cores:
            self.close()
            raise ValueError(f"a piece takes {cores} cores; the largest node of the Ray cluster has {max(sizes)}")
        self.workers = sum(size // cores for size in sizes)

    def run(self, work: Work[Piece, Outcome], pieces: Sequence[Piece], done: Done[Outcome]) -> None:
        """Do the pieces; Ctrl-C, or a piece that fails, ends all pieces under way at once.

        Raises
        ------
        WorkerDied
            If the processes or nodes of one piece have died four times, or the cluster is gone.
        ValueError
            If a node has other code than this machine.
        """
        ray = self._ray
        task = ray.remote(num_cpus=self.cores, max_retries=RETRIES)(_do)
        common = ray.put(ray.cloudpickle.dumps(work))
        stamp = code_stamp(work)
        pending: dict[Any, int] = {}
        try:
            for k, piece in enumerate(pieces):
                pending[task.remote(stamp, common, ray.cloudpickle.dumps(piece))] = k
            while pending:
                ready, _ = ray.wait(list(pending), num_returns=1, timeout=_LOOK)
                for reference in ready:
                    done(pending[reference], _outcome(ray.get(reference)))
                    del pending[reference]
        except ray.exceptions.RayTaskError as error:
            said = str(error).strip().splitlines()[-1].strip()
            raise ValueError(f"a node of the Ray cluster cannot do its piece of work: {said}") from None
        except ray.exceptions.RayError as error:
            said = f"{RETRIES + 1} times on one piece of work: {' '.join(str(error).split())}"
            raise WorkerDied(f"a process or node of the Ray cluster has died, {said}") from None
        finally:
            _give_up(ray, pending, done)

    def close(self) -> None:
        """Leave the cluster; end it if it was begun here."""
        if self._began:
            self._ray.shutdown()
            self._began = False


def load_ray() -> Any:
    """Return the module ``ray``.

    Raises
    ------
    ModuleNotFoundError
        If it is not installed; the message explains how to install it.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Ray reports to its makers unless told not to
    with needed_for("a Ray cluster", "'ray[rllib]'"):
        return importlib.import_module("ray")


def check_cluster() -> None:
    """Raise now, not when the work begins, if Ray is not installed or no cluster is at ``RAY_ADDRESS``.

    Ray itself would try to reach it for minutes, and then end the process.

    Raises
    ------
    ValueError
        If nothing listens at the address.
    ModuleNotFoundError
        If Ray is not installed; the message explains how to install it.
    """
    load_ray()
    address = os.environ.get("RAY_ADDRESS", "")
    host, _, port = address.rpartition("//")[2].partition("/")[0].rpartition(":")
    if host and port.isdecimal():
        try:
            socket.create_connection((host, int(port)), timeout=_REACHED).close()
        except OSError as error:
            raise ValueError(f"cannot connect to a Ray cluster at RAY_ADDRESS {address}: {error}") from None


def _begin(ray: Any) -> bool:
    """Connect to the cluster, or begin one; False if this process was connected before."""
    if ray.is_initialized():
        return False
    check_cluster()
    try:
        with _signals_kept():
            ray.init(include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise ValueError(f"cannot connect to a Ray cluster: {error}") from None
    return True


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Handle signals afterwards as before: Ray sets a handler of its own for SIGTERM."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        with suppress(ValueError):  # not in the main thread, where Ray has set none either
            signal.signal(signal.SIGTERM, before)


def _give_up(ray: Any, pending: dict[Any, int], done: Done[Any]) -> None:
    """Hand over what has been finished meanwhile, and end what has not; none is pending after a run that went well."""
    if not pending or not ray.is_initialized():
        return
    ready, under_way = ray.wait(list(pending), num_returns=len(pending), timeout=0)
    for reference in under_way:
        ray.cancel(reference, force=True)
    for reference in ready:
        try:
            outcome = _outcome(ray.get(reference))
        except Exception:  # the failure that has ended the run, or another one
            continue
        done(pending[reference], outcome)


def _outcome(found: tuple[bool, bytes]) -> Any:
    """Return what a piece returned, or raise what it raised."""
    succeeded, content = found
    value = pickle.loads(content)
    if not succeeded:
        raise value
    return value


def code_stamp(work: Any) -> tuple[str, ...]:
    """Return what decides the numbers of a piece beside the piece: sources of this package and of the work's, and versions."""
    names = {__name__.partition(".")[0], work.__module__.partition(".")[0]}
    files = [sys.modules[name].__file__ for name in sorted(names) if hasattr(sys.modules[name], "__path__")]
    folders = [Path(file).parent for file in files if file is not None]
    python = ".".join(map(str, sys.version_info[:2]))
    return (*(source_stamp(folder) for folder in folders), f"NumPy {np.__version__}", f"Python {python}")


# -------------------------------------------------------------------------------------------------- on the nodes


def _do(stamp: tuple[str, ...], work: bytes, piece: bytes) -> tuple[bool, bytes]:
    """Do a piece; errors travel as values, so that what Ray itself raises can be told from them.

    All travels as bytes: arrays that Ray hands over itself cannot be written to.
    """
    from ray import cloudpickle

    try:
        doing = _loaded(work, stamp)
        return True, cloudpickle.dumps(doing(pickle.loads(piece), never))
    except Exception as error:
        return False, cloudpickle.dumps(error)


def _loaded(work: bytes, stamp: tuple[str, ...]) -> Any:
    """Return the work, if this node has the code for it."""
    try:
        doing = pickle.loads(work)
        here = code_stamp(doing)
        other = [f"{one} instead of {wanted}" for one, wanted in zip(here, stamp, strict=True) if one != wanted]
        problem = f"other code or other versions: {', '.join(other)}" if other else ""
    except ModuleNotFoundError as error:
        problem = f"no module {error.name}"
    if problem:
        cure = "install the same everywhere, or send the code along with `ray job submit --working-dir .`"
        raise ValueError(f"node {socket.gethostname()} of the Ray cluster has {problem}; {cure}")
    return doing
