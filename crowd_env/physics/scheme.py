"""What a contact scheme is: its facts, its parameters, and one compiled call that advances a batch of crowds."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from crowd_env.physics.world import Batch
from crowd_env.state import Bodies


@dataclass(frozen=True)
class SchemeInfo:
    """Facts about a scheme that tests and reports ask for."""

    name: str
    title: str
    reference: str  # paper and equations
    order: int  # of convergence in the time step, on a smooth case
    conserves_energy_at_contact: bool  # of two bodies, with the default parameters
    overlap: str  # what overlap its default parameters leave, in words
    stable_step: str  # formula of the largest stable time step


class ContactScheme(Protocol):
    """A frozen dataclass of parameters; all memory is handed in."""

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        ...

    def stable_dt(self, bodies: Bodies) -> float:
        """Largest stable time step [s]; infinite for an unconditionally stable scheme."""
        ...

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Overlap [m] that the scheme states it stays below in a room of people who push at their desired speed."""
        ...

    def check(self, driving: bool) -> None:
        """Raise ValueError if the scheme cannot be used for pedestrians (``driving``) or for passive grains."""
        ...

    def advance(self, batch: Batch, dt: float, n_substeps: int, first: int, stop: int) -> None:
        """Advance the environments ``first:stop`` to step ``n_substeps`` of this call, in place.

        `Memory.progress` says from where.  Other environments are neither read nor written.
        """
        ...


def require_positive(scheme: str, why: str = "", **values: float) -> None:
    """Raise ValueError, naming scheme, parameter and formula, unless every value is > 0 (infinity is allowed)."""
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"{scheme}: {name} is {value!r}; it must be > 0{why and ': ' + why}")


def require_known(scheme: str, name: str, value: str, known: Iterable[str]) -> None:
    """Raise ValueError, naming scheme and parameter, unless the value is a known one."""
    if value not in known:
        raise ValueError(f"{scheme}: unknown {name} {value!r}; known: {', '.join(known)}")


def require_not_negative(scheme: str, why: str = "", **values: float) -> None:
    """Raise ValueError, naming scheme, parameter and formula, unless every value is >= 0 (infinity is allowed)."""
    for name, value in values.items():
        if not value >= 0:
            raise ValueError(f"{scheme}: {name} is {value!r}; it must be >= 0{why and ': ' + why}")
