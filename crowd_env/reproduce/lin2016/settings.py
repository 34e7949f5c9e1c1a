"""What the reproductions of Lin, Ma, Lo may vary: the draws, and the readings of what their paper leaves open."""

from dataclasses import dataclass
from typing import Literal

from crowd_env.core.checks import COUNT, POSITIVE
from crowd_env.physics import Hertz, SocialForce
from crowd_env.physics.hertz import DampingUnit
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.paper import TARGET_HELP, Settings, option
from crowd_env.routing.route_set import Target
from crowd_env.scenarios import make_scenario

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

    runs: int = option(10, "Draws of each point", COUNT)
    preset: Preset = option(
        "calibrated",
        "calibrated: friction and social force of walls, which the paper leaves open, fitted to its Figure 7; literal: its "
        "text as printed",
    )
    dt: float = option(1e-3, "Time step, s", POSITIVE)
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

    def scheme(self, strength: float = 300.0, rotation: bool | None = None) -> Hertz:
        """Return how people touch; ``strength`` [N] is A of the social force."""
        friction, social = self.walls
        force = SocialForce(strength=strength, anisotropy=self.anisotropy, wall_strength=social, cutoff=self.cutoff)
        return Hertz(
            friction=self.friction,
            wall_friction=friction,
            rotation=not self.no_rotation if rotation is None else rotation,
            damping_unit=_DAMPING_UNITS[self.damping],
            social=force,
        )

    def case(self, people: int, speed: float, strength: float = 300.0, rotation: bool | None = None) -> Case:
        """Return all draws of ``people`` with the desired ``speed`` [m/s]."""
        scheme = self.scheme(strength, rotation)
        place = make_scenario(
            "lin-room-v0", people=people, desired_speed=speed, exit_depth=self.exit_depth, target=self.target,
            time_limit=1000.0, blocked_after=120.0,
        )  # fmt: skip
        facts = {"people": people, "desired_speed_mps": speed, "strength_N": strength, "rotation": scheme.rotation}
        label = f"{people}-people-{speed:g}-mps"
        return Case(label, place, scheme, self.seeds, self.dt, facts=facts)

    def readings(self) -> str:
        """Return in one line what the runs rest on, for the foot of a figure."""
        friction, social = self.walls
        fitted = {"calibrated": ", both FITTED to Figure 7", "literal": ", the text as printed"}
        own = self.wall_friction is not None or self.wall_social is not None
        source = ", as asked for" if own else fitted[self.preset]
        text = f"walls: friction {friction:g}, social force {social:g} N{source}"
        rest = [f"{k} {v}" for k, v in self.changed().items() if k not in ("preset", "wall_friction", "wall_social")]
        return "; ".join([f"{self.runs} draw{'s' if self.runs > 1 else ''} each", text, *rest])
