"""Mixed crowds: actions move a part of the pedestrians; the others walk at full speed or by another policy."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Unpack

from crowd_env import CrowdEnv, Step
from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.action import make_action, to_command
from crowd_env.envs.arguments import MIXED, Place, drawn_share
from crowd_env.envs.settings import EnvArguments, arguments_of
from crowd_env.physics.settings import Walking

from .policy import Policy


def learned_people(seeds: Sequence[int], people: int, share: float) -> Bools:
    """Return which pedestrians actions move (R, N) in runs of these seeds: ``share`` of each, at least one pedestrian.

    The seed of a run alone draws them: the same pedestrians under every policy and scheme.  A larger share includes a smaller.
    """
    return np.array([drawn_share(np.random.default_rng((seed, MIXED)), people, share) for seed in seeds])


class BatchArguments(EnvArguments, total=False):
    """The arguments of a batch of environments: those of one, their number, and whether they restart."""

    num_envs: int
    autoreset: bool


class MixedEnv(CrowdEnv):
    """A batch of evacuations in which actions move some of the pedestrians, other ones in every episode.

    No observation shows which they are.  A reset by a list of seeds draws them as `learned_people` does.  A manner is that of
    the others alone.

    Parameters
    ----------
    scenario, arguments : as `CrowdEnv` takes them.
    share : of the pedestrians of each environment that actions move, at least one.
    others : policy of the others, on the observations of this environment; None = they walk at full speed along their route.

    Attributes
    ----------
    learned : (P,) pedestrians that actions move.

    Raises
    ------
    ValueError
        If the policy of the others acts in the axes of the world, or chooses exits.
    """

    learned: Bools
    _kept = (*CrowdEnv._kept, "_rng", "_seen")

    def __init__(
        self,
        scenario: Place | Sequence[Place],
        *,
        share: float,
        others: Policy | None = None,
        **arguments: Unpack[BatchArguments],
    ) -> None:
        arguments["walking"] = replace(Walking.of(arguments.get("walking")), share=share)
        super().__init__(scenario, **arguments)
        self.share, self.others = share, others
        self._rng = np.random.default_rng(0)  # for actions that the others draw
        self._seen = np.zeros((self.num_people, self.layout.size), dtype=np.float32)
        if others is not None:
            self._kind = make_action(arguments_of(others.env_options).get("action", "continuous"))
            if self._kind.frame != "path" or self._kind.routes is not None:
                raise ValueError(f"policy {others.name!r} cannot move the others: it must act along the path alone")

    def reset(
        self, seed: int | Sequence[int | None] | None = None, mask: ArrayLike | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Start new episodes, as `CrowdEnv.reset` does."""
        self._seen, info = super().reset(seed, mask)
        return self._seen, info

    def step(self, action: ArrayLike | None = None, scripted: ArrayLike | None = None) -> Step:
        """Advance by one decision step, as `CrowdEnv.step` does."""
        step = super().step(action, scripted)
        self._seen = step.observation
        return step

    def _command(
        self, action: ArrayLike | None, scripted: ArrayLike | None
    ) -> tuple[Floats | None, Bools | None, Bools | None]:
        if self.others is None:
            return super()._command(action, scripted)
        if action is None:  # learned pedestrians walk at full speed
            neutral = np.asarray(self.action_kind.neutral)
            action = np.broadcast_to(neutral, (self.num_people, *neutral.shape))
        command, in_world, gives_way = super()._command(action, scripted)
        others = ~self.learned if scripted is None else ~self.learned | np.asarray(scripted)
        rows = np.flatnonzero(others & self.active)
        acts = self.others.act(self._seen[rows], self.layout, self._rng)
        if acts is not None and command is not None:
            command[rows] = to_command(acts, self._kind, np.ones(len(rows), dtype=bool))[0]
        return command, in_world, gives_way
