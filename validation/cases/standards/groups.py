"""Test of people who belong together: the quick ones wait for the slow one."""

from dataclasses import dataclass

import numpy as np

from crowd_env import Cohorts, Scenario, Uniform
from validation.cases.case import Setting, Verdict, adults
from validation.cases.crowds import Floats, draw_crowds
from validation.cases.standards.places import place

SPEEDS = (1.25, 1.25, 1.25, 1.25, 0.5)  # m/s, of the group
_OTHERS, _SLOW = 10, 0.5  # people, m/s
WITHIN = 10.0  # s, from the first of the five to the last


@dataclass(frozen=True)
class Given:
    """A distribution that draws these values, in their order."""

    values: tuple[float, ...]

    @property
    def low(self) -> float:
        """The smallest."""
        return min(self.values)

    @property
    def high(self) -> float:
        """The largest."""
        return max(self.values)

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Return the values."""
        return np.array(self.values)


def spreads(setting: Setting, size: int | None) -> list[float]:
    """Return the time [s] from the first of the five to the last, of each draw; infinite if one of them is left inside."""
    five = adults(len(SPEEDS), desired_speed=Given(SPEEDS), group_size=size, start_region="back", name="group")
    others = adults(_OTHERS, desired_speed=Uniform(_SLOW, _SLOW), start_region="middle", name="others")
    crowds = draw_crowds([Scenario("group", place("group"), Cohorts((five, others)), 180.0)], setting)
    out = crowds.walk(180.0).exit_time.reshape(setting.draws, -1)[:, : len(SPEEDS)]
    return np.nan_to_num(np.ptp(out, axis=1), nan=np.inf).tolist()


def keep_together(setting: Setting) -> Verdict:
    """ISO 14, NIST 2.9: a group of five, one of them slow, leave a room of 20 m x 15 m in which ten others are slow too."""
    together, alone = (max(spreads(setting, size)) for size in (len(SPEEDS), None))
    figure = f"the five are out within {together:.1f} s of each other at most; within {alone:.1f} s if each walks alone"
    return Verdict(together <= WITHIN, figure, {"together": together, "alone": alone})
