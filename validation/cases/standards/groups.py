"""Tests of what people do because of others, or of what they know: groups, and the choice of exits."""

from dataclasses import dataclass, replace

import numpy as np

from crowd_env import Cohorts, Scenario, Uniform
from validation.cases.case import Setting, Verdict, adults
from validation.cases.crowds import Floats, draw_crowds
from validation.cases.standards.evacuations import exits_taken
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


def companions(setting: Setting) -> Verdict:
    """ISO 15, NIST 3.2: of two exits as far away people take that of the first of their group; alone, either.

    Companions influence the choice; what strangers choose does not.
    """
    shares = []
    for size in (3, None):
        three = adults(3, start_region="middle", group_size=size)
        taken = exits_taken(replace(setting, draws=40), place("apart"), three, strategy="nearest")
        shares.append(float((taken[:, 1:] == taken[:, :1]).mean()))
    together, alone = shares
    figure = (
        f"{100 * together:.0f} % of companions take the exit of the first, {100 * alone:.0f} % of people on their own"
    )
    return Verdict(together >= 0.9 and together > alone + 0.2, figure, {"together": together, "alone": alone})


def familiar_exit(setting: Setting) -> Verdict:
    """ISO 16, NIST 3.3: of two exits as far away half of all take either, and most the one that four in five know alone."""
    shares = []
    for knowing in (0, 16):
        some = (
            adults(20 - knowing, start_region="middle"),
            adults(knowing or 1, start_region="middle", exits=("east",)),
        )
        people = Cohorts(some[: 2 if knowing else 1])
        taken = exits_taken(replace(setting, draws=20), place("apart"), people, strategy="nearest")
        shares.append(float((taken == place("apart").exit_names.index("east")).mean()))
    free, familiar = shares
    figure = f"{100 * free:.0f} % take the one exit, {100 * familiar:.0f} % if 80 % know no other"
    return Verdict(abs(free - 0.5) <= 0.1 and familiar >= 0.7, figure, {"free": free, "familiar": familiar})
