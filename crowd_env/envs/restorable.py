"""Checkpoints of environments: the moment of what stands behind one, and what it keeps itself."""

import copy
from collections.abc import Collection, Mapping
from typing import Any, ClassVar, NamedTuple

from crowd_env.physics.simulation.checkpoint import require_checkpoint, require_same


class EnvCheckpoint(NamedTuple):
    """A moment of an environment; made by `Restorable.checkpoint`, taken up by `Restorable.restore`.  It can be pickled."""

    made_by: dict[str, Any]  # properties that must equal those of the environment to restore
    behind: Any  # checkpoint of what stands behind it
    kept: dict[str, Any]  # what it keeps itself, by name


class Restorable:
    """An environment, or an interface in front of one, that goes back to a moment with all that stands behind it."""

    _behind: ClassVar[str] = "env"  # attribute with checkpoints of its own
    _kept: Collection[str] = ()  # attributes that change from step to step
    _times_restored = 0

    @property
    def times_restored(self) -> int:
        """How often the simulation went back to a moment."""
        return int(getattr(getattr(self, self._behind), "times_restored", 0))

    def checkpoint(self) -> EnvCheckpoint:
        """Return a copy of all that the future depends on, to `restore` here, or in an environment made like this one.

        The last observation is not included: callers that need it keep it beside the checkpoint.

        Raises
        ------
        ValueError
            If what stands behind this one was restored alone.
        """
        self._check_whole()
        return EnvCheckpoint(self._made_by(), getattr(self, self._behind).checkpoint(), copy.deepcopy(self._keep()))

    def restore(self, checkpoint: EnvCheckpoint) -> None:
        """Restore a checkpoint: the same actions, and resets without a seed, lead to the same results bit by bit.

        Raises
        ------
        TypeError
            If it is no checkpoint of an environment.
        ValueError
            If the checkpoint is of another kind of environment, or of other people, places, scheme, steps, limits or rewards.
        """
        require_checkpoint(checkpoint, EnvCheckpoint, "an environment")
        require_same(self._made_by(), checkpoint.made_by, "environment")
        getattr(self, self._behind).restore(checkpoint.behind)
        self._take_back(copy.deepcopy(checkpoint.kept))
        self._agree()

    def _made_by(self) -> dict[str, Any]:
        """Return what an environment must have in common with this one to restore a checkpoint of it."""
        return {"class": type(self).__name__}

    def _keep(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self._kept}

    def _take_back(self, kept: Mapping[str, Any]) -> None:
        vars(self).update(kept)

    def _agree(self) -> None:
        """Note that what stands behind this one is at the same moment."""
        self._times_restored = self.times_restored

    def _check_whole(self) -> None:
        """Raise ValueError if what stands behind this one was restored alone."""
        if self._times_restored != self.times_restored:
            what = type(getattr(self, self._behind)).__name__
            raise ValueError(f"the {what} alone was restored, the {type(self).__name__} was not; restore or reset that")
