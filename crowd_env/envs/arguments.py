"""What callers and learning libraries give an environment: checked before anything is computed."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from crowd_env.core.arrays.balance import BALANCES, Balance, Balancing, make_balance
from crowd_env.core.arrays.headway import MANNERS, Headway, Manner, plain_manner
from crowd_env.core.arrays.outline import OUTLINES, BodyShape, Outline, plain_outline
from crowd_env.core.arrays.pulls import ALONE
from crowd_env.core.arrays.state import Bodies, Bools, make_bodies
from crowd_env.core.checks import NOT_NEGATIVE, Range, number, refuse, whole
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.scenario import Scenario

Place: TypeAlias = str | Path | Mapping[str, Any] | Scenario
"""How callers say what is evacuated: a name, a file, a table of a name and options, or a Scenario."""

DRIVE = Range(0.0, above=True, infinite=True)
_MOST_PARTS = 1e5
MOST_PEOPLE_IN_BATCH = 10_000_000
NUMBERS = "biuf"  # kinds of dtype that an action may have


def scenarios_of(scenario: Any, people: int | None, num_envs: int) -> list[Scenario]:
    """Return the scenarios of a batch, one alone as a list of one, with so many ``people`` each if that is given.

    Raises
    ------
    ValueError
        If it is something else, there is none, or a batch of ``num_envs`` has more people than any memory has room for.
    """
    if isinstance(scenario, str | Path | Scenario | Mapping):
        scenario = [scenario]
    elif not isinstance(scenario, Iterable) or isinstance(scenario, bytes):
        refuse("scenario", scenario, "the name of a scenario, its file, a Scenario, a table, or a list of them")
    options = {} if people is None else {"people": people}
    scenarios = [make_scenario(one, **options) for one in scenario]
    if not scenarios:
        raise ValueError("no scenario; give at least one")
    each = sum(one.population.people for one in scenarios) / len(scenarios)
    if num_envs * each > MOST_PEOPLE_IN_BATCH:
        refuse("num_envs", num_envs, f"at most {int(MOST_PEOPLE_IN_BATCH // each)} with {each:g} people in each")
    return scenarios


def manner_and_outline(
    scenarios: Sequence[Scenario], manner: Manner | None, outline: BodyShape | None
) -> tuple[Headway | None, Outline | None]:
    """Return how people walk in a batch and what shape bodies have: as is given, or where that is None as the scenarios say.

    Raises
    ------
    ValueError
        If one of them is unknown, or the scenarios do not say the same.
    """
    first, found = scenarios[0], [(one.manner_of_run(manner), one.outline_of_run(outline)) for one in scenarios]
    walk, shape = found[0]
    for scenario, (other_walk, other_shape) in zip(scenarios, found, strict=True):
        if other_walk != walk:
            both = f"{plain_manner(walk)} in {first.name}, {plain_manner(other_walk)} in {scenario.name}"
            way = f"walking={next(iter(MANNERS))!r}"
            raise ValueError(f"the people of one batch walk in one manner, not {both}; say which: {way}")
        if other_shape != shape:
            both = f"{plain_outline(shape)} in {first.name}, {plain_outline(other_shape)} in {scenario.name}"
            way = f"physics=Physics(outline={next(iter(OUTLINES))!r})"
            raise ValueError(f"the people of one batch have one outline, not {both}; say which: {way}")
    return walk, shape


def one_drive(scenarios: Sequence[Scenario], given: float | None, drives: bool) -> float | None:
    """Return the largest drive [N] of the people of a batch: as is given, or as the scenarios say; None = no limit.

    Raises
    ------
    ValueError
        If the scenarios do not say the same.
    """
    found = {one.max_drive for one in scenarios} if given is None else {number("max_drive", given, DRIVE, "N")}
    if len(found) > 1:
        both = " and ".join(f"{drive:g} N" for drive in sorted(found))
        raise ValueError(
            f"the people of one batch drive alike, not with at most {both}; say which: Physics(max_drive=300.0)"
        )
    limit = found.pop()
    return None if np.isinf(limit) or (given is None and not drives) else limit


def one_balance(scenarios: Sequence[Scenario], given: Balancing | None) -> Balance | None:
    """Return how those who stand in a batch keep upright: as is given, or as the scenarios say.

    Raises
    ------
    ValueError
        If the scenarios do not say the same.
    """
    found = [make_balance(one.balance if given is None else given) for one in scenarios]
    if any(one != found[0] for one in found):
        way = f"physics=Physics(balance={next(iter(BALANCES))!r})"
        raise ValueError(f"the people of one batch keep upright in one way, not in two; say which: {way}")
    return found[0]


def parts_of(what: str, duration: float, parts: str, part: float) -> int:
    """Return the number of ``parts`` of length ``part`` [s] in a duration [s].

    Raises
    ------
    ValueError
        If it is not a whole number of at least 1, or so large that nobody lives to see the end.
    """
    ratio = duration / part
    if ratio > _MOST_PARTS:
        raise ValueError(
            f"{what} = {duration:g} s has {ratio:.3g} {parts} = {part:g} s; at most {_MOST_PARTS:g} are computed"
        )
    if not ratio > 0.5 or abs(ratio - round(ratio)) > 1e-6:
        raise ValueError(f"{what} = {duration:g} s is not a whole number of {parts} = {part:g} s")
    return round(ratio)


def bodies_before_reset(scenarios: Sequence[Scenario]) -> Bodies:
    """Return bodies (P,) for the crowds of some environments, all as wide, heavy and quick as their population allows.

    They hold the room of those that a reset draws; all who may walk in company do so together.
    """
    parts = [part for scenario in scenarios for part in scenario.population.parts]
    counts = [part.people for part in parts]
    return make_bodies(
        np.repeat([part.radius.high for part in parts], counts),
        np.repeat([part.mass.high for part in parts], counts),
        desired_speed=np.repeat([part.desired_speed.high for part in parts], counts),
        relaxation_time=np.repeat([part.relaxation_time.low for part in parts], counts),
        company=np.repeat([0 if part.walks_together else ALONE for part in parts], counts),
        env_start=np.cumsum([0, *(scenario.population.people for scenario in scenarios)]),
    )


def seed_words(seed: int | Sequence[int] | None, num_envs: int) -> list[list[int] | None]:
    """Return the words that seed each environment's generator; None = go on drawing from the present one.

    Parameters
    ----------
    seed : an int gives environment ``e`` the words (seed, e); a sequence gives each (its own, 0).

    Raises
    ------
    ValueError
        If a seed is no whole number >= 0, or there are not as many as environments.
    """
    if seed is None:
        return [None] * num_envs
    if not isinstance(seed, list | tuple | np.ndarray):
        word = whole("seed", seed, NOT_NEGATIVE)
        return [[word, e] for e in range(num_envs)]
    if len(seed) != num_envs:
        raise ValueError(f"{len(seed)} seeds for {num_envs} environments; give one each, or a single int")
    return [[whole("seed", word, NOT_NEGATIVE), 0] for word in seed]


def check_options(options: Any, known: Collection[str] = (), *, idle: Collection[str] = ()) -> None:
    """Raise ValueError unless ``options`` of a reset is None or a dictionary of known names; ``idle`` names do nothing."""
    if options is None:
        return
    if not isinstance(options, Mapping):
        refuse("options", options, "a dictionary or None")
    for name in options:
        if name not in known and name not in idle:
            raise ValueError(
                f"unknown reset option {name!r}; known: {', '.join(known) or 'none'}; "
                "all else is given when the environment is made"
            )


def reset_mask(options: Any, count: int) -> Bools | None:
    """Return the mask (``count``,) of Gymnasium's reset option ``reset_mask``, true where to reset; None = everywhere.

    The option stays in the dictionary: wrappers around the environment read it, too.

    Raises
    ------
    ValueError
        If it is no boolean array of that shape or is nowhere true, or if there are other options.
    """
    check_options(options, ("reset_mask",))
    if not options or "reset_mask" not in options:
        return None
    mask = options["reset_mask"]
    if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (count,) and mask.any()):
        refuse("reset_mask", mask, f"a NumPy array of {count} booleans, one an environment, with at least one True")
    return mask.copy()
