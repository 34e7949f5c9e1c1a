"""What every case shares: rows, effort, blocks taken in turn, ratios, and the CPU time of one function among others."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol


class Row(NamedTuple):
    """One figure; ``what`` reads "who, how many: quantity"."""

    what: str
    value: float
    unit: str
    peer: str | None = None  # whose figure it is; with a ratio: whom it is compared with
    ratio: float | None = None  # how many times better than the peer, measured in turn with it


def silent(_: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Effort:
    """How long to measure, and what.

    Parameters
    ----------
    seconds : CPU time of a block.
    blocks : blocks of each figure, in turn with those of others, of which the fastest counts.
    peers : also measure other programs, as far as they are installed.
    peer_seconds : s on the clock after which a block of another program is cut short.
    max_people : leave out crowds that are larger.
    tell : takes a line about what is being measured.
    """

    seconds: float = 0.5
    blocks: int = 3
    peers: bool = False
    peer_seconds: float = 10.0
    max_people: int = 100_000
    tell: Callable[[str], None] = silent

    def __post_init__(self) -> None:
        for name, value in (("--seconds", self.seconds), ("--peer-seconds", self.peer_seconds)):
            if not 0 < value < float("inf"):
                raise ValueError(f"{name} is {value}; it must be > 0 and finite")
        if self.blocks < 1:
            raise ValueError(f"--blocks is {self.blocks}; it must be at least 1")
        if self.max_people < 1:
            raise ValueError(f"--max-people is {self.max_people}; it must be at least 1")

    def sizes(self, known: Sequence[int]) -> list[int]:
        """Return those of the known numbers of people that are not too large; the smallest in any case."""
        return [size for size in known if size <= self.max_people] or [min(known)]


class Sample(NamedTuple):
    """One block of a contender, or several together."""

    cpu: float  # s    of all threads of the process
    clock: float  # s
    simulated: float  # s
    steps: float  # people inside x physics steps, or decisions

    @property
    def cost(self) -> float:
        """CPU seconds per simulated second."""
        return self.cpu / self.simulated

    @property
    def rate(self) -> float:
        """Steps per CPU second."""
        return self.steps / self.cpu


class Contender(Protocol):
    """Someone who is measured in turn with others."""

    @property
    def name(self) -> str:
        """What the rows say."""
        ...

    @property
    def peer(self) -> str | None:
        """Name and version if it is another program."""
        ...

    @property
    def whole(self) -> float:
        """Simulated seconds of a whole run: a block that is shorter saw only a part of it."""
        ...

    def block(self, effort: Effort) -> Sample:
        """Go on for about so long."""
        ...


def in_turn(contenders: Sequence[Contender], effort: Effort) -> list[Sample]:
    """Measure all in turn, block by block, so that what else the machine does hits all alike.

    The fastest block of each counts.  If blocks saw only a part of a run, different parts, all of them count together:
    the fastest would be the easiest part.
    """
    blocks: list[list[Sample]] = [[] for _ in contenders]
    for turn in range(effort.blocks):
        for k, contender in enumerate(contenders):
            effort.tell(f"{contender.name}, block {turn + 1} of {effort.blocks}")
            blocks[k].append(contender.block(effort))
    return [fastest(one, contender.whole) for one, contender in zip(blocks, contenders, strict=True)]


def fastest(blocks: Sequence[Sample], whole: float) -> Sample:
    """Return the block with the highest rate, or all together if one of them is shorter than a ``whole`` run."""
    if min(block.simulated for block in blocks) < 0.999 * whole:
        return Sample(*(sum(column) for column in zip(*blocks, strict=True)))
    return max(blocks, key=lambda block: block.rate)


def times_better(ours: float, theirs: float, unit: str) -> float:
    """Return how many times better ``ours`` is: of costs theirs / ours, of rates (unit "1/...") ours / theirs."""
    return significant(ours / theirs if unit.startswith("1/") else theirs / ours, 3)


class Stopwatch:
    """Adds up the CPU time of the calls of one function.

    >>> watch = Stopwatch(venv, "step_wait")   # from here on, calls of venv.step_wait are timed
    """

    def __init__(self, owner: Any, method: str) -> None:
        self.seconds = 0.0
        self.calls = 0
        self._call: Callable[..., Any] = getattr(owner, method)
        setattr(owner, method, self._timed)

    def _timed(self, *args: Any, **kwargs: Any) -> Any:
        begin = time.process_time()
        try:
            return self._call(*args, **kwargs)
        finally:
            self.seconds += time.process_time() - begin
            self.calls += 1

    def restart(self) -> None:
        """Set the sum back to zero."""
        self.seconds, self.calls = 0.0, 0


def significant(value: float, digits: int = 4) -> float:
    """Round to so many digits: more would pretend."""
    return float(f"{value:.{digits}g}")
