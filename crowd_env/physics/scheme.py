"""Contact schemes: facts, a frozen dataclass of parameters, and one compiled call that advances a batch of crowds."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from crowd_env.core.arrays.state import Bodies
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import COUNT, POSITIVE, Range, check_fields
from crowd_env.core.kernels.struct_ref import StructRef
from crowd_env.physics.driving_force import influences
from crowd_env.physics.social_force import SocialForce, make_social
from crowd_env.physics.solvers import Stopping

DECISION_DT = 0.1  # s  default time between two decisions of a policy


@dataclass(frozen=True)
class SchemeInfo:
    """Facts about a scheme for tests and reports."""

    name: str  # in `SCHEMES`
    title: str
    reference: str  # paper and equations
    order: int  # of convergence in the time step, on a smooth case
    conserves_energy_at_contact: bool  # of two bodies, with the default parameters
    overlap: str  # overlap left by its default parameters, in words
    stable_step: str  # formula of the largest stable time step
    uses: tuple[str, ...]  # optional arrays of `workspace`; a social force adds its own
    contacts_at: Literal["start", "end"] = "start"  # of the step: the positions of the listed contacts
    default_dt: float = 0.01  # s  longest physics step unless a caller gives one; see `ContactScheme.default_dt`
    # Impulse over time is the force on a body; else it only keeps bodies apart.
    impulses_are_forces: bool = True


@dataclass(frozen=True)
class ContactScheme(ABC):
    """Base of all schemes: a frozen dataclass of parameters without memory of its own.

    A scheme defines `info`, `overlap_bound`, `kernel` and `parameters`; ``examples/my_law.py`` is a first example.  The
    defaults of all else fit a scheme that is unconditionally stable in contact, moves pedestrians and grains, and steps a
    crowd on one thread.

    Parameters
    ----------
    social : social force, its name in ``SOCIAL_FORCES`` or a table of its parameters; None = no force before
        contact.
    """

    _: KW_ONLY
    social: SocialForce | None = None

    ALLOWED: ClassVar[Mapping[str, Range]] = {}  # range of each parameter, by name; else any finite number
    # Whether several threads can step one crowd together: the kernel then takes ``thread, threads`` last.
    shares_crowds: ClassVar[bool] = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "social", make_social(self.social))
        check_fields(type(self).__name__.lower(), self, **self.ALLOWED)

    @property
    @abstractmethod
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""

    def stable_dt(self, bodies: Bodies) -> float:
        """Return the largest stable time step [s]: here 2 tau_min, of the explicit driving force alone."""
        return 2.0 * float(bodies.relaxation_time.min())

    def default_dt(self, bodies: Bodies, within: float = DECISION_DT, outline: Outline | None = None) -> float:
        """Return the default physics step [s]: here that of `info`, the paper's.

        ``within`` [s] is a time that should be a whole number of steps.  ``bodies`` are the most extreme that a scenario can
        draw, so the step does not depend on the other people of a batch.
        """
        return self.info.default_dt

    @abstractmethod
    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return a bound of the overlap [m] in a room of people pushing at their desired speed."""

    @property
    def turns_bodies(self) -> bool:
        """Whether contacts turn bodies, which an outline needs."""
        return False

    @property
    def drives(self) -> bool:
        """Whether the scheme has a driving force, which a largest drive limits."""
        return True

    def check(self, driving: bool) -> None:  # noqa: B027  # most schemes accept all
        """Raise ValueError if the scheme cannot move pedestrians (``driving``) or passive grains."""

    def slabs(self, people: int, reach: float) -> int:
        """Return the number of slabs of a crowd that threads share, with forces of a ``reach`` [m]; 1 = it is not cut."""
        return 1

    def advance(
        self,
        batch: StructRef,
        dt: float,
        n_substeps: int,
        env_first: int,
        env_stop: int,
        thread: int = 0,
        threads: int = 1,
        *,
        desire: Any = None,
    ) -> None:
        """Advance the environments ``env_first:env_stop`` of a `Batch` to step ``n_substeps`` of this call, in place.

        `Workspace.substep` holds the steps done so far.  Other environments are neither read nor written.  With ``threads`` > 1
        as many threads make this call at once, each with its number ``thread``, and share the slabs.  ``desire`` changes the
        desired velocity, see `crowd_env.core.behaviors.behavior.Behavior`.
        """
        acting = influences(self.social, batch, desire)
        shared = (thread, threads) if self.shares_crowds else ()
        self.kernel(batch, dt, n_substeps, env_first, env_stop, acting, *self.parameters(), *shared)

    @property
    @abstractmethod
    def kernel(self) -> Callable[..., None]:
        """The compiled loop: takes batch, dt, n_substeps, env_first, env_stop, acting and `parameters`."""

    @abstractmethod
    def parameters(self) -> tuple[Any, ...]:
        """Return the scheme's own parameters as its kernel takes them."""


@dataclass(frozen=True)
class IterativeScheme(ContactScheme):
    """Base of schemes that solve for all impulses of a step together, by sweeps over the contacts.

    Parameters
    ----------
    tolerance : m/s, residual at which the solver stops.
    relative_tolerance : if given, the residual (its 2-norm over the contacts) must also be below this share of its value
        without any impulse.
    max_iterations : sweeps after which a step is given up and counted in ``Diagnostics.unconverged``.
    """

    _: KW_ONLY
    tolerance: float = 1e-4
    relative_tolerance: float | None = None
    max_iterations: int = 20_000

    ALLOWED: ClassVar[Mapping[str, Range]] = {
        "tolerance": POSITIVE.because("the solver stops on it"),
        "relative_tolerance": POSITIVE,
        "max_iterations": COUNT.because("the solver stops on it"),
    }

    def stopping(self) -> Stopping:
        """Return the stopping rule of the solver for kernels."""
        relative = np.inf if self.relative_tolerance is None else self.relative_tolerance
        return Stopping(self.tolerance, relative, self.max_iterations)


def arrays_of(scheme: ContactScheme, acting: Iterable[type[Behavior]] = ()) -> frozenset[str]:
    """Return the optional arrays of `workspace` that a scheme and the acting behaviors need."""
    social = ("desired_velocity", "force", "heading", "social_pairs") if scheme.social is not None else ()
    return frozenset((*scheme.info.uses, *social, *(name for behavior in acting for name in behavior.USES)))
