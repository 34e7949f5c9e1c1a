"""What every case shares: rows, effort, blocks taken in turn, and figures as a table."""

import contextlib
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

from validation.pages import pivoted


class Row(NamedTuple):
    """One figure of one contender."""

    who: str
    quantity: str  # with its unit
    value: float


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
    tell: Callable[[str], object] = lambda _: None

    def __post_init__(self) -> None:
        for name in ("seconds", "blocks", "peer_seconds", "max_people"):
            if not 0 < getattr(self, name) < float("inf"):
                raise ValueError(f"--{name.replace('_', '-')} is {getattr(self, name)}; it must be > 0 and finite")

    def sizes(self, known: Sequence[int]) -> list[int]:
        """Return those of the known numbers of people that are not too large; the smallest in any case."""
        return [size for size in known if size <= self.max_people] or [min(known)]


class Sample(NamedTuple):
    """One block of a contender, a part of it, or several together."""

    cpu: float  # s    of all threads of the process
    clock: float  # s
    simulated: float  # s
    steps: float  # people inside x physics steps, or decisions

    def plus(self, other: "Sample") -> "Sample":
        """Return both together."""
        return Sample(*map(sum, zip(self, other, strict=True)))

    @property
    def cost(self) -> float:
        """CPU seconds per simulated second."""
        return self.cpu / self.simulated

    @property
    def rate(self) -> float:
        """Steps per CPU second."""
        return self.steps / self.cpu


NOTHING = Sample(0.0, 0.0, 0.0, 0.0)


class Contender(ABC):
    """What is measured in turn with others."""

    name: str
    whole = 0.0  # s    simulated in a whole run
    all = NOTHING  # of the blocks so far, together
    is_peer = False  # another program, which makes whole runs within `Effort.peer_seconds`
    failed = False  # gave up in this run, which ends the block

    @abstractmethod
    def once(self) -> Sample:
        """Go on for as little as can be measured."""

    def block(self, effort: Effort) -> Sample:
        """Go on for about ``effort.seconds`` of CPU time; a peer for whole runs, or ``effort.peer_seconds`` on the clock."""
        found, (whole, limit) = NOTHING, (self.whole, effort.peer_seconds) if self.is_peer else (0.0, float("inf"))
        with quiet():
            while found.clock < limit and (found.cpu < effort.seconds or found.simulated < whole - 1e-9):
                found = found.plus(self.once())
                if self.failed:
                    break
        self.all = self.all.plus(found)
        return found


class Stepped(Contender):
    """An environment in which all agents act, reset after each episode; it is stepped once when it is made.

    Parameters
    ----------
    step : makes a decision for all agents.
    agents : counts the agents that act.
    reset : begins an episode, which is not counted.
    episode : steps.
    """

    def __init__(
        self, name: str, step: Callable[[], Any], agents: Callable[[], int], reset: Callable[[], Any], episode: int
    ) -> None:
        self.name, self._step, self._agents, self._reset = name, step, agents, reset
        self._episode, self._left = episode, 0
        self.once()

    def once(self) -> Sample:
        """Step once."""
        if self._left == 0 or not self._agents():
            self._reset()
            self._left = self._episode
        self._left -= 1
        agents = self._agents()
        return Sample(*timed(self._step), 0.1, agents)


def in_turn(contenders: Sequence[Contender], effort: Effort) -> list[Sample]:
    """Measure all in turn, block by block, so that background load affects all equally.

    The fastest block of each counts.  If blocks saw only a part of a run, different parts, all of them count together:
    the fastest would be the easiest part.
    """
    blocks: list[list[Sample]] = [[] for _ in contenders]
    for turn in range(effort.blocks):
        for mine, contender in zip(blocks, contenders, strict=True):
            effort.tell(f"{contender.name}, block {turn + 1} of {effort.blocks}")
            mine.append(contender.block(effort))
    return [fastest(mine, contender.whole) for mine, contender in zip(blocks, contenders, strict=True)]


def fastest(blocks: Sequence[Sample], whole: float) -> Sample:
    """Return the block with the highest rate, or all together if one of them is shorter than a ``whole`` run."""
    if min(block.simulated for block in blocks) < 0.999 * whole:
        return reduce(Sample.plus, blocks)
    return max(blocks, key=lambda block: block.rate)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what others print off the standard output, which is ours."""
    with contextlib.redirect_stdout(sys.stderr):
        yield


def timed(call: Callable[[], Any]) -> tuple[float, float]:
    """Return the seconds that a call takes, of CPU time and on the clock."""
    clock, begin = time.perf_counter(), time.process_time()
    call()
    return time.process_time() - begin, time.perf_counter() - clock


class Stopwatch:
    """Adds up the CPU time of the calls of a method: ``watch = Stopwatch(venv, "step_wait")``."""

    def __init__(self, owner: Any, method: str) -> None:
        self.seconds = 0.0
        self._call: Callable[..., Any] = getattr(owner, method)
        setattr(owner, method, self._timed)

    def _timed(self, *args: Any, **kwargs: Any) -> Any:
        begin = time.process_time()
        try:
            return self._call(*args, **kwargs)
        finally:
            self.seconds += time.process_time() - begin


def times(who: str, mine: float, others: Mapping[str, float]) -> list[Row]:
    """Return how many times the speeds of others that of one contender is."""
    return [Row(who, f"times {name}", mine / speed) for name, speed in others.items()]


def grid(rows: Sequence[Row]) -> list[list[str]]:
    """Return figures as a table, the head first: a line for each contender, a column for each quantity."""
    shown = [{**row._asdict(), "value": number(row.value)} for row in rows]
    return pivoted(shown, {"": "{who}"}, "{quantity}", "{value}")


def number(value: float) -> str:
    """Return a figure with three digits: more would pretend; large ones with a suffix."""
    for limit, size, suffix in ((1e9, 1e9, " G"), (1e6, 1e6, " M"), (1e4, 1e3, " k")):
        if abs(value) >= limit:
            return f"{value / size:.3g}{suffix}"
    return f"{float(f'{value:.3g}'):.6g}"
