"""What the reproductions of Lin, Ma, Lo may vary: the draws, and the readings of what their paper leaves open."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

from crowd_env.physics import Hertz
from crowd_env.physics.hertz import DampingUnit
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.pecol2011.settings import flag
from crowd_env.routing.route_set import Target

Preset = Literal["calibrated", "literal"]
Damping = Literal["per-length", "rate", "critical"]

_PRESETS = {"calibrated": Hertz(), "literal": Hertz.literal()}
_DAMPING_UNITS: dict[str, DampingUnit] = {"per-length": "rate per length", "rate": "rate", "critical": "critical"}


@dataclass(frozen=True)
class LinSettings:
    """Options of a reproduction; None means what the preset says.

    Raises
    ------
    ValueError
        In one sentence, if an option is out of range.
    """

    preset: Preset = "calibrated"
    runs: int = 10
    seed: int = 0  # draw k is made from seed + k, the same start in every configuration
    dt: float = 1e-3  # s
    wall_friction: float | None = None
    wall_social: float | None = None  # N
    anisotropy: float = 0.3  # phi
    no_rotation: bool = False
    damping: Damping = "per-length"  # reading of gamma
    target: Target = "centre"
    exit_depth: float = 0.0  # m
    cutoff: float = 0.4  # m

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise ValueError(f"--runs is {self.runs}; it must be at least 1")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; it must be >= 0")
        for name, kind in (("preset", Preset), ("damping", Damping), ("target", Target)):
            if getattr(self, name) not in get_args(kind):
                raise ValueError(f"unknown {flag(name)} {getattr(self, name)!r}; known: {', '.join(get_args(kind))}")
        for name in ("dt", "wall_friction", "wall_social", "anisotropy", "exit_depth", "cutoff"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{flag(name)} is {value}; it must be a finite number")
        if not self.dt > 0:
            raise ValueError(f"--dt is {self.dt:g} s; it must be > 0")

    @property
    def walls(self) -> tuple[float, float]:
        """Friction of walls and their social force [N]."""
        preset = _PRESETS[self.preset]
        assert preset.social is not None
        friction = preset.wall_friction if self.wall_friction is None else self.wall_friction
        social = preset.social.wall_strength if self.wall_social is None else self.wall_social
        return friction, social

    def changed(self) -> dict[str, object]:
        """Return the options that differ from the defaults, without how many draws are made."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("runs", "seed")}
        return {name: value for name, value in values.items() if value != getattr(LinSettings, name)}

    def draws(self, count: int, desired_speed: float, **more: Any) -> tuple[Run, ...]:
        """Return every draw of ``count`` people who want ``desired_speed`` [m/s]; ``more`` are parameters of `Run`."""
        friction, social = self.walls
        first = Run(
            count,
            desired_speed,
            rotation=not self.no_rotation,
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
        last = self.seed + self.runs - 1
        seeds = f"Draw {self.seed} is" if self.runs == 1 else f"Draws {self.seed} to {last} are"
        return [
            walls,
            f"{seeds} the same start in every configuration. A run is blocked, as in the paper, when nobody has got out for "
            "2 minutes; it has no clearance time, and medians are over the runs that cleared.",
        ]


def check(runs: Iterable[Run]) -> None:
    """Raise ValueError, before anything runs, if one of the configurations cannot be used; one draw of each is tried."""
    for run in dict.fromkeys(replace(run, seed=0) for run in runs):
        run.check()
