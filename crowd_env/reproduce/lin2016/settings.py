"""What the reproductions of Lin, Ma, Lo may vary: the draws, and the readings of what their paper leaves open."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from crowd_env.physics import Hertz
from crowd_env.physics.hertz import DampingUnit
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.settings import TARGET_HELP, Settings, flag, option
from crowd_env.routing.route_set import Target

Preset = Literal["calibrated", "literal"]
Damping = Literal["per-length", "rate", "critical"]

_PRESETS = {"calibrated": Hertz(), "literal": Hertz.literal()}
_DAMPING_UNITS: dict[str, DampingUnit] = {"per-length": "rate per length", "rate": "rate", "critical": "critical"}


@dataclass(frozen=True)
class LinSettings(Settings):
    """Options of the paper's figures; None means what the preset says.

    Raises
    ------
    ValueError
        In one sentence, if an option is out of range.
    """

    runs: int = option(10, "Draws of each point")
    preset: Preset = option(
        "calibrated",
        "calibrated: friction and social force of walls, which the paper leaves open, fitted to its Figure 7; literal: its "
        "text as printed",
    )
    dt: float = option(1e-3, "Time step, s")
    friction: float = option(0.5, "Friction of people on people")
    wall_friction: float | None = option(None, "Friction of people on walls; calibrated 0.1, literal 0.5")
    wall_social: float | None = option(None, "Social force of walls at zero distance, N; calibrated 300, literal 0")
    anisotropy: float = option(0.3, "phi of the social force")
    no_rotation: bool = option(False, "Nobody turns (lin-fig5 compares both)")
    damping: Damping = option(
        "per-length",
        "Reading of gamma = 0.8: per-length (1/(m s)), rate (1/s) or critical (share of the critical damping)",
    )
    target: Target = option("centre", TARGET_HELP)
    exit_depth: float = option(0.0, "How far behind the wall people count as out, m")
    cutoff: float = option(0.4, "Distance beyond which there is no social force, m")

    @property
    def walls(self) -> tuple[float, float]:
        """Friction of walls and their social force [N]."""
        preset = _PRESETS[self.preset]
        assert preset.social is not None
        friction = preset.wall_friction if self.wall_friction is None else self.wall_friction
        social = preset.social.wall_strength if self.wall_social is None else self.wall_social
        return friction, social

    def draws(self, count: int, desired_speed: float, **more: Any) -> tuple[Run, ...]:
        """Return every draw of ``count`` people who want ``desired_speed`` [m/s]; ``more`` are parameters of `Run`."""
        friction, social = self.walls
        first = Run(
            count,
            desired_speed,
            rotation=not self.no_rotation,
            friction=self.friction,
            wall_friction=friction,
            wall_social=social,
            anisotropy=self.anisotropy,
            damping=_DAMPING_UNITS[self.damping],
            cutoff=self.cutoff,
            target=self.target,
            exit_depth=self.exit_depth,
            dt=self.dt,
        )
        return tuple(replace(first, seed=self.seed + k, **more) for k in range(self.runs))

    def readings(self) -> str:
        """Return in one line what the runs rest on, for the foot of a figure."""
        friction, social = self.walls
        fitted = {"calibrated": ", both fitted to Figure 7", "literal": ", the text as printed"}
        own = self.wall_friction is not None or self.wall_social is not None
        text = (
            f"walls: friction {friction:g}, social force {social:g} N{', as asked for' if own else fitted[self.preset]}"
        )
        rest = [
            f"{flag(k)} {v}" for k, v in self.changed().items() if k not in ("preset", "wall_friction", "wall_social")
        ]
        return "; ".join([f"{self.runs} draw{'s' if self.runs > 1 else ''} each", text, *rest])

    def remarks(self) -> list[str]:
        """Return in words what the runs rest on."""
        friction, social = self.walls
        values = f"friction {friction:g} and a social force of {social:g} N"
        if self.wall_friction is not None or self.wall_social is not None:
            walls = f"Walls have {values}, as asked for. The paper says nothing about walls."
        elif self.preset == "calibrated":
            walls = (
                f"Preset calibrated: walls have {values}. Both are FITTED to Figure 7, because the paper says nothing about "
                "walls; all else is its text and Table 1. --preset literal leaves the fitting out."
            )
        else:
            walls = (
                f"Preset literal: the text as printed. Walls have {values}: the one friction coefficient of Table 1, and no "
                "social force, because the paper mentions none."
            )
        return [
            walls,
            f"{self.draws_are} the same start in every configuration. A run is blocked, as in the paper, when nobody has got "
            "out for 2 minutes; it has no clearance time, and medians are over the runs that cleared.",
        ]
