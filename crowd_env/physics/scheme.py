"""What a contact scheme is: facts, a frozen dataclass of parameters, and one compiled call that advances a batch of crowds."""

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

DECISION_DT = 0.1  # s  between two decisions of a policy, unless somebody says otherwise


@dataclass(frozen=True)
class SchemeInfo:
    """Facts about a scheme that tests and reports ask for."""

    name: str  # in `SCHEMES`
    title: str
    reference: str  # paper and equations
    order: int  # of convergence in the time step, on a smooth case
    conserves_energy_at_contact: bool  # of two bodies, with the default parameters
    overlap: str  # what overlap its default parameters leave, in words
    stable_step: str  # formula of the largest stable time step
    uses: tuple[str, ...]  # of what arrays of `workspace` need; a social force adds its own
    contacts_at: Literal["start", "end"] = "start"  # of the step: where the listed contacts are those of the positions
    default_dt: float = 0.01  # s  longest physics step unless a caller gives one; see `ContactScheme.default_dt`
    # Impulse over time is the force that a body bears; else it only keeps bodies apart.
    impulses_are_forces: bool = True


@dataclass(frozen=True)
class ContactScheme(ABC):
    """Base of all schemes: a frozen dataclass of parameters; all memory is handed in.

    A scheme has to give `info`, `overlap_bound`, `kernel` and `parameters`; ``examples/my_law.py`` is one to begin with.  The
    defaults of the rest are those of a scheme that is unconditionally stable in contact, moves pedestrians and grains, and
    steps a crowd on one thread.

    Parameters
    ----------
    social : social force, its name in ``SOCIAL_FORCES`` or a table of its parameters; None = people do not mind until they
        touch.
    """

    _: KW_ONLY
    social: SocialForce | None = None

    ALLOWED: ClassVar[Mapping[str, Range]] = {}  # of its numbers, by name; any finite number if not said
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
        """Return the physics step [s] of such people unless a caller gives one: here that of `info`, the paper's.

        ``within`` [s] is a time that should be a whole number of steps.  ``bodies`` are the most extreme that a scenario can
        draw: who else is in a batch is of no account.
        """
        return self.info.default_dt

    @abstractmethod
    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return the overlap [m] below which the scheme stays in a room of people who push at their desired speed."""

    @property
    def turns_bodies(self) -> bool:
        """Whether contacts turn bodies: only then they may have an outline."""
        return False

    @property
    def drives(self) -> bool:
        """Whether people are driven by a force, which a largest drive limits."""
        return True

    def check(self, driving: bool) -> None:  # noqa: B027  # most schemes accept all
        """Raise ValueError if the scheme has no use for pedestrians (``driving``) or passive grains."""

    def slabs(self, people: int, driving: bool) -> int:
        """Return into how many slabs a crowd is cut that several threads can step together; 1 = it is not cut."""
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

        `Workspace.substep` says from where.  Other environments are neither read nor written.  With ``threads`` > 1 as many
        threads make this call at once, each with its own number ``thread``, and share the slabs.  ``desire`` changes what
        people want, see `crowd_env.core.behaviors.behavior.Behavior`.
        """
        acting = influences(self.social, batch, desire)
        shared = (thread, threads) if self.shares_crowds else ()
        self.kernel(batch, dt, n_substeps, env_first, env_stop, acting, *self.parameters(), *shared)

    @property
    @abstractmethod
    def kernel(self) -> Callable[..., None]:
        """The compiled loop of the scheme: of the batch, dt, n_substeps, env_first, env_stop, acting and `parameters`."""

    @abstractmethod
    def parameters(self) -> tuple[Any, ...]:
        """Return the scheme's own parameters as its kernel takes them."""


@dataclass(frozen=True)
class IterativeScheme(ContactScheme):
    """Base of the schemes that solve for all impulses of a step together, by sweeps over the contacts.

    Parameters
    ----------
    tolerance : m/s, residual at which the solver stops.
    relative_tolerance : if given, the residual (its 2-norm over the contacts) must also be below this share of what it would be
        without any impulse.
    max_iterations : after so many a step is given up and counted in ``Diagnostics.unconverged``.
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
        """Return when the solver stops, as kernels read it."""
        relative = np.inf if self.relative_tolerance is None else self.relative_tolerance
        return Stopping(self.tolerance, relative, self.max_iterations)


def arrays_of(scheme: ContactScheme, acting: Iterable[type[Behavior]] = ()) -> frozenset[str]:
    """Return what arrays of `workspace` are needed: by a scheme, and by the behaviors that act."""
    social = ("desired_velocity", "force", "heading", "social_pairs") if scheme.social is not None else ()
    return frozenset((*scheme.info.uses, *social, *(name for behavior in acting for name in behavior.USES)))
