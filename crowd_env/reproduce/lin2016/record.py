"""What comes of a run: when people got out, whether the exit blocked, and the crowd at chosen moments; as JSON too."""

import math
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple


class Snapshot(NamedTuple):
    """Where those who are inside are at one moment; K people."""

    time: float  # s
    x: tuple[float, ...]  # (K,) m
    y: tuple[float, ...]  # (K,) m
    radius: tuple[float, ...]  # (K,) m
    angle: tuple[float, ...]  # (K,) rad    turned since the start


@dataclass(frozen=True)
class Record:
    """What came of a run."""

    exit_times: tuple[float, ...]  # s    ascending, of those who got out before the exit blocked
    left: int  # people inside at the end
    blocked_since: float | None = None  # s    when the last one got out before the exit blocked; 0 if nobody did
    snapshots: tuple[Snapshot, ...] = ()

    @property
    def clearance_time(self) -> float | None:
        """When the last one got out [s]; None if someone did not, blocked or not."""
        return self.exit_times[-1] if self.left == 0 else None

    def as_json(self) -> dict[str, Any]:
        """Return the record, ready for JSON."""
        return {**asdict(self), "snapshots": [snapshot._asdict() for snapshot in self.snapshots]}

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> "Record":
        """Return the record that was encoded, with every bit of every number.

        Raises
        ------
        ValueError, KeyError, TypeError
            If it cannot be a record.
        """
        since = content["blocked_since"]
        snapshots = tuple(
            Snapshot(float(s["time"]), *(tuple(map(float, s[name])) for name in Snapshot._fields[1:]))
            for s in content["snapshots"]
        )
        times, left = tuple(map(float, content["exit_times"])), int(content["left"])
        if not all(map(math.isfinite, times)) or list(times) != sorted(times):
            raise ValueError("the exit times of the record are not finite and ascending")
        if since is not None and left <= 0:
            raise ValueError("the record says that the exit blocked, with nobody left inside")
        return cls(times, left, None if since is None else float(since), snapshots)
