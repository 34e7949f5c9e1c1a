"""What a case is: something that is known about crowds, and how the simulations do beside it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

Figures = dict[str, float | str | None]  # name, with its unit -> what was measured; None where there is none


@dataclass(frozen=True)
class Settings:
    """What a case is asked for.

    Attributes
    ----------
    schemes : contact schemes; those of the case if there are none.
    data : folder with the recordings, which are no part of the repository.
    draws : evacuations of each scheme, each with other people; as many as the case takes by default if None.
    out : folder for the files of the case.
    notify : hears what is being computed.
    """

    schemes: tuple[str, ...] = ()
    data: Path | None = None
    draws: int | None = None
    out: Path | None = None
    notify: Callable[[str], object] = lambda _: None


class Finding(NamedTuple):
    """What was found under one scheme.

    Attributes
    ----------
    scheme : of the simulation, or "recorded".
    passed : whether it meets the criterion of the case; None where there is no bar to pass.
    figure : what was measured.
    """

    scheme: str
    passed: bool | None
    figure: Figures


@dataclass(frozen=True)
class Case:
    """A case: everything but the geometry and the population, which its `measure` knows.

    Attributes
    ----------
    title : what happens in it.
    criterion : what has to hold, or what is compared.
    source : of the data, or of the bounds.
    schemes : that it takes by default.
    measure : computes its findings one by one.
    needs_data : whether it reads recordings.
    """

    title: str
    criterion: str
    source: str
    schemes: tuple[str, ...]
    measure: Callable[[Settings], Iterator[Finding]]
    needs_data: bool = False


class Row(NamedTuple):
    """A line of the report: a finding, and what it was held against."""

    case: str
    scheme: str
    passed: bool | None
    figure: Figures
    criterion: str
    source: str


def rows(name: str, case: Case, settings: Settings) -> Iterator[Row]:
    """Compute a case and give its rows one by one.

    Raises
    ------
    ValueError
        If it needs recordings and there are none.
    """
    if case.needs_data and settings.data is None:
        raise ValueError(f"case {name} reads recordings; name their folder by --data ({case.source})")
    findings = case.measure(replace(settings, schemes=settings.schemes or case.schemes))
    for finding in findings:
        yield Row(name, *finding, case.criterion, case.source)
