"""Arguments of an environment, checked before any computation."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, make_bodies
from crowd_env.core.behaviors import BEHAVIORS
from crowd_env.core.behaviors.pulls import ALONE
from crowd_env.core.checks import NOT_NEGATIVE, Plain, refuse, whole
from crowd_env.physics.settings import Physics, Walking
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.cohorts import greatest_bodies
from crowd_env.scenarios.scenario import Scenario

Place: TypeAlias = str | Path | Plain | Scenario
"""How callers say what is evacuated: a name, a file, a table of a name and options, or a Scenario."""

_MOST_PARTS = 1e5
MOST_PEOPLE_IN_BATCH = 10_000_000
NUMBERS = "biuf"  # kinds of dtype that an action may have
MIXED = 7  # second word of a run's seed, for the draw of the pedestrians that actions move


def scenarios_of(scenario: Any, people: int | None, num_envs: int) -> list[Scenario]:
    """Return the scenarios of a batch, one alone as a list of one, each with this number of ``people`` if it is given.

    Raises
    ------
    ValueError
        If it is of a wrong type, names another number of ``people``, there is none or more than environments, or people of
        ``num_envs`` do not fit into memory.
    """
    if isinstance(scenario, str | Path | Scenario | Mapping):
        scenario = [scenario]
    elif not isinstance(scenario, Iterable) or isinstance(scenario, bytes):
        refuse("scenario", scenario, "the name of a scenario, its file, a Scenario, a table, or a list of them")
    options = {} if people is None else {"people": people}
    scenario = list(scenario)
    for one in scenario:
        if options and isinstance(one, Mapping) and one.get("people", people) != people:
            raise ValueError(
                f"people={people} is given beside a scenario with people={one['people']!r}; give one of them"
            )
    scenarios = [make_scenario(one, **options) for one in scenario]
    if not scenarios:
        raise ValueError("no scenario; give at least one")
    if len(scenarios) > num_envs:
        unused, rooms = scenarios[num_envs].name, "1 environment" if num_envs == 1 else f"{num_envs} environments"
        raise ValueError(f"{len(scenarios)} scenarios for {rooms}: {unused} would never be used; give one each at most")
    each = sum(one.population.people for one in scenarios) / len(scenarios)
    if num_envs * each > MOST_PEOPLE_IN_BATCH:
        refuse("num_envs", num_envs, f"at most {int(MOST_PEOPLE_IN_BATCH // each)} with {each:g} people in each")
    return scenarios


def settle(scenarios: Sequence[Scenario], physics: Physics, walking: Walking) -> tuple[Physics, Walking]:
    """Return the settings of a batch with all behaviors in them: the given ones, else the scenarios' ones.

    Raises
    ------
    ValueError
        If a behavior is unknown, the scenarios disagree, or the scheme does not support it.
    """
    chosen: dict[str, Any] = {}
    for name, kind in BEHAVIORS.items():
        given = getattr(physics if hasattr(physics, name) else walking, name)
        if kind.PER_PLACE:
            chosen[name] = [getattr(one, name) for one in scenarios] if given is None else given
            continue
        found = [kind.of(getattr(one, name) if given is None else given) for one in scenarios]
        for scenario, other in zip(scenarios, found, strict=True):
            if other != found[0]:
                both = f"{kind.plain_of(found[0])} in {scenarios[0].name}, {kind.plain_of(other)} in {scenario.name}"
                part = "physics=Physics" if hasattr(physics, name) else "walking=Walking"
                raise ValueError(f"the people of one batch have one {name}, not {both}; say which: {part}({name}=...)")
        left_out = given is None and kind.YIELDS and kind.NEEDS and not getattr(physics.law, kind.NEEDS)
        chosen[name] = None if left_out else found[0]
    of_physics, of_walking = (
        {name: chosen[name] for name in chosen if hasattr(part, name)} for part in (physics, walking)
    )
    return replace(physics, **of_physics), replace(walking, **of_walking)


def parts_of(what: str, duration: float, parts: str, part: float) -> int:
    """Return the number of ``parts`` of length ``part`` [s] in a duration [s].

    Raises
    ------
    ValueError
        If it is not a whole number of at least 1, or too large.
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
    """Return bodies (P,) for the crowds of some environments, all with the greatest radius, mass and speed of their population.

    They have the capacity of the bodies that a reset draws; all pedestrians that may walk in groups are one group.
    """
    parts = [part for scenario in scenarios for part in scenario.population.parts]
    counts = [part.people for part in parts]
    return make_bodies(
        **greatest_bodies(parts, counts),
        group=np.repeat([0 if part.walks_together else ALONE for part in parts], counts),
        env_start=np.cumsum([0, *(scenario.population.people for scenario in scenarios)]),
    )


def seed_words(seed: int | Sequence[int | None] | None, num_envs: int) -> list[list[int] | None]:
    """Return the words that seed each environment's generator; None = go on drawing from the present one.

    Parameters
    ----------
    seed : an int gives environment ``e`` the words (seed, e); a sequence gives each (its own, 0), or None.

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
    return [None if word is None else [whole("seed", word, NOT_NEGATIVE), 0] for word in seed]


def drawn_share(rng: np.random.Generator, people: int, share: float) -> Bools:
    """Return which of ``people`` (N,) are drawn: a ``share``, at least one.  A larger share includes a smaller."""
    found = np.zeros(people, dtype=bool)
    found[rng.permutation(people)[: max(1, round(share * people))]] = True
    return found


def check_options(options: Any, known: Collection[str] = (), *, idle: Collection[str] = ()) -> None:
    """Raise ValueError unless ``options`` of a reset is None or a dictionary of known names; ``idle`` names are ignored."""
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
