"""What a case is: an experiment that is known, run under a contact scheme and a manner of walking, and judged."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env import SCHEMES, Normal, Population, Uniform
from crowd_env.core.behaviors.headway import MANNERS, Headway
from crowd_env.core.behaviors.outline import BodyShape, Outline, room_of
from crowd_env.core.checks import Plain
from crowd_env.envs.metrics import share_interval
from validation.pages import read_toml

# Schemes that are compared by default; what papers print and this package does otherwise is for comparison with them,
# nsm1-loose walks as nsm1 does, and helbing is for `crowd-env reproduce faster-is-slower`.
COMPARED = tuple(name for name in SCHEMES if name not in ("nsm1-loose", "nsm2-printed", "hertz-literal", "helbing"))
DISC = "disc"  # what bodies are unless a run says otherwise


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
    strategy : how people choose their way; None = as in the scenario, see `crowd_env.Scenario`.
    outline : shape of all bodies, a name in ``OUTLINES``, an Outline or a table of its parameters.
    notify : hears what is being computed.
    """

    scheme: Any = "nsm2"
    manner: str | Plain | Headway | None = "hurried"
    draws: int = 5
    seed: int = 0
    data: Path | None = None
    strategy: str | None = None
    outline: BodyShape = DISC
    notify: Callable[[str], object] = lambda _: None

    @property
    def room(self) -> float:
        """The radius within which a body can turn freely, as a multiple of its nominal radius."""
        return room_of(Outline.of(self.outline))


class Row(NamedTuple):
    """What came of one case under one scheme and one manner.

    Attributes
    ----------
    case, scheme, manner : their names.
    passed : whether the criterion is met; None if there is none.
    figure : the numbers, as a sentence.
    criterion : what has to hold.
    source : where the criterion comes from.
    more : the numbers behind the figure, as JSON holds them.
    outline : shape of the bodies.
    """

    case: str
    scheme: str
    manner: str
    passed: bool | None
    figure: str
    criterion: str
    source: str
    more: dict[str, Any]
    outline: str = DISC


@dataclass(frozen=True)
class Case:
    """An experiment that can be run under any scheme and manner.

    Parameters
    ----------
    title : what happens in it.
    run : computes its rows.
    source : where its criterion and numbers come from.
    criterion : what has to hold; empty where it is that of each row.
    draws : how many crowds it takes by default.
    manners : those under which it is run by default.
    recordings : whether it looks at `Setting.data`.
    draw : writes a picture of all its rows into a folder.
    discs_because : why bodies of another outline cannot be in it; empty = they can.
    """

    title: str
    run: Callable[[Setting], Iterable[Row]]
    source: str
    criterion: str = ""
    draws: int = 20
    manners: Sequence[str] = tuple(MANNERS)
    recordings: bool = False
    draw: Callable[[Path, Sequence[Row]], None] | None = None
    discs_because: str = ""


# What cases.toml says of the cases, of the tests of standards, and of those that are not supported.
FACTS: dict[str, dict[str, Any]] = read_toml(Path(__file__).with_name("cases.toml"))
RECORDED: dict[str, dict[str, Any]] = read_toml(Path(__file__).with_name("recorded.toml"))


def row(
    case: str, setting: Setting, passed: bool | None, figure: str, criterion: str = "", source: str = "", **more: Any
) -> Row:
    """Return a row under the names of scheme, manner and outline.

    Criterion and source are those of the case, or test of a standard, unless given.
    """
    said = (FACTS["cases"] | FACTS["tests"]).get(case, {})
    criterion, source = criterion or said.get("criterion", ""), source or said.get("source", "")
    scheme = setting.scheme if isinstance(setting.scheme, str) else setting.scheme.info.name
    manner = setting.manner if isinstance(setting.manner, str) else str(setting.manner)
    outline = setting.outline if isinstance(setting.outline, str) else str(setting.outline)
    return Row(case, scheme, manner, passed, figure, criterion, source, plain(more), outline)


def number(value: float, digits: int = 2) -> str:
    """Return a number with ``digits`` decimals, or a dash if it is not finite."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def share(count: int, of: int) -> str:
    """Return "2 of 20 (3 to 30 %)": a count with the 95 % interval of its share (Wilson)."""
    low, high = share_interval(count, of)
    return f"{count} of {of} ({100.0 * low:.0f} to {100.0 * high:.0f} %)"


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


class Verdict(NamedTuple):
    """Whether a test is passed, the figures as a sentence, and the numbers behind them."""

    passed: bool | None  # None = the standard asks for figures, not for a bound
    figure: str
    more: dict[str, Any]
