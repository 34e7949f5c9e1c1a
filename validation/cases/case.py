"""What a case of the validation map is given, and what it answers."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env import Normal, Population, Uniform
from crowd_env.physics.walking.headway import Headway


@dataclass(frozen=True)
class Setting:
    """How people push and walk, and how often each experiment is run.

    Parameters
    ----------
    scheme : name in ``SCHEMES``, or a scheme.
    manner : name in ``MANNERS``, a headway rule or a table of its parameters.
    draws : number of crowds that are drawn; results are means over them.
    seed : of the draws; crowds of one seed are the same under every scheme and manner.
    data : folder with recordings, for cases that compare with one.
    strategy : how people choose their way; a case may need another one and says so.
    """

    scheme: Any = "nsm2"
    manner: str | Mapping[str, Any] | Headway | None = "hurried"
    draws: int = 5
    seed: int = 0
    data: Path | None = None
    strategy: str = "fastest"


@dataclass(frozen=True)
class Row:
    """What came of one case under one scheme and one manner.

    Parameters
    ----------
    passed : whether the criterion is met; None if there is none, or it could not be judged.
    figure : the numbers, as a sentence.
    more : the numbers behind it.
    """

    case: str
    scheme: str
    manner: str
    passed: bool | None
    figure: str
    criterion: str
    source: str
    more: dict[str, Any] = field(default_factory=dict)


class Case(NamedTuple):
    """An experiment that can be run under any scheme and manner."""

    title: str
    run: Callable[[Setting], list[Row]]
    source: str
    needs_data: str = ""  # the recording that it cannot do without
    takes_data: str = ""  # the recording that it compares with if it is there


def row(case: str, setting: Setting, passed: bool | None, figure: str, criterion: str, source: str, **more: Any) -> Row:
    """Return a row under the names of scheme and manner."""
    scheme = setting.scheme if isinstance(setting.scheme, str) else setting.scheme.info.name
    manner = setting.manner if isinstance(setting.manner, str) else str(setting.manner)
    return Row(case, scheme, manner, passed, figure, criterion, source, plain(more))


def plain(value: Any) -> Any:
    """Return numbers, arrays, lists and tables of them as JSON holds them; what is not finite becomes None."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set):
        return [plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def adults(count: int, **options: Any) -> Population:
    """Return people as they are in every case unless a recording or a standard says otherwise.

    Desired speeds are those of Weidmann 1993, 1.34 ± 0.26 m/s, cut to 0.8 to 1.9 m/s; discs of 0.30 to 0.38 m across, about
    the depth of a chest and half the shoulders of adults, as wide as recorded people at the gate allow; masses and relaxation
    times are those of the package.
    """
    people: dict[str, Any] = {"desired_speed": Normal(1.34, 0.26, 0.8, 1.9), "radius": Uniform(0.15, 0.19)}
    return Population(count, **(people | options))
