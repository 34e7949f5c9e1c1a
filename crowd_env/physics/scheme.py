"""What a contact scheme is: its facts, its parameters, and one compiled call that advances a batch of crowds."""

from dataclasses import dataclass
from typing import Literal, Protocol

from crowd_env._kernels.struct_ref import StructRef
from crowd_env.physics.social_force import SocialForce
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
    uses: tuple[str, ...]  # of the arrays in `workspace.OPTIONAL`; a social force adds what it needs
    contacts_at: Literal["start", "end"] = "start"  # of the step: where the listed contacts are those of the positions
    default_dt: float = 0.01  # s  physics step if none is asked for: the paper's


def arrays_of(scheme: "ContactScheme") -> frozenset[str]:
    """Return which of the arrays in `workspace.OPTIONAL` a scheme works with."""
    social = ("desired_velocity", "force", "heading", "social_pairs") if scheme.social is not None else ()
    return frozenset((*scheme.info.uses, *social))


class ContactScheme(Protocol):
    """A frozen dataclass of parameters; all memory is handed in."""

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        ...

    @property
    def social(self) -> SocialForce | None:
        """How people keep their distance before they touch; None = not at all."""
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

    def slabs(self, people: int, driving: bool) -> int:
        """Into how many slabs a crowd of so many is cut that several threads can step together; 1 = it is not."""
        ...

    def advance(
        self, batch: StructRef, dt: float, n_substeps: int, first: int, stop: int, thread: int = 0, threads: int = 1
    ) -> None:
        """Advance the environments ``first:stop`` of a `Batch` to step ``n_substeps`` of this call, in place.

        `Workspace.substep` says from where.  Other environments are neither read nor written.  With ``threads`` > 1 as many
        threads make this call at once, each with its own number ``thread``, and share the slabs.
        """
        ...
