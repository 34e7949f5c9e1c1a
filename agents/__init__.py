"""Policies over arrays, rule-based and learned, behind one protocol."""

from crowd_env.core.checks import NAMES

from .policy import Policy
from .pretrained import PRETRAINED, load
from .rules import RandomWalk, ShortestPath, StandStill
from .tasks.presets import ALL_PLACES
from .trained import LearnedPolicy, names_file
from .walking import DensityCap, Evolved, Follow, HeadwayRule, RuleAtShare, YieldWhenStuck, Zipper

# Name -> policy.  The names in `PRETRAINED` and paths to trained networks (.safetensors) are policies too: see `make_policy`.
POLICIES: dict[str, type[Policy]] = {
    "random": RandomWalk,
    "stand-still": StandStill,
    "shortest": ShortestPath,
    "rule-best-speed": RuleAtShare,
    "density-cap": DensityCap,
    "headway": HeadwayRule,
    "follow": Follow,
    "evolution": Evolved,
    "yield-when-stuck": YieldWhenStuck,
    "zipper": Zipper,
}
NAMES["policy"] = POLICIES


def make_policy(policy: str | Policy) -> Policy:
    """Return a policy by name or from a trained network, or the policy itself.

    Parameters
    ----------
    policy : a name in `POLICIES`, that of a shipped policy in `PRETRAINED`, or a path that ends in .safetensors.

    Raises
    ------
    ValueError
        If the name is unknown, or the network cannot be read or sends people to exits.
    """
    if not isinstance(policy, str):
        return policy
    if names_file(policy) or policy in PRETRAINED:
        found = load(policy)
        if not isinstance(found, LearnedPolicy):
            raise ValueError(f"{policy} is a {found.what}, no {LearnedPolicy.what}")
        return found
    if policy not in POLICIES:
        names = ", ".join([*POLICIES, *PRETRAINED])
        raise ValueError(f"unknown policy {policy!r}; known: {names}, or the path of a network (.safetensors)")
    return POLICIES[policy]()


def starts_from(policy: str) -> str:
    """Return the start of learning of a policy: "nothing", what it cloned, or "a rule" for a policy without learning.

    Nothing is full speed: the default start of PPO, and of a search over weights that are all 0.  A policy of all places cloned
    the best of several policies in each, its "teachers".
    """
    if names_file(policy) or policy in PRETRAINED:
        trained = load(policy).trained
        in_all_places = (trained.get("task") or {}).get("name") == ALL_PLACES["name"]
        return "teachers" if in_all_places else told_start(trained.get("start"))
    return "nothing" if policy == Evolved.name else "a rule"


def told_start(start: str | None) -> str:
    """Return `starts_from` for a training with this ``start``; None is unknown."""
    return {None: "–", "rule": "nothing", "nothing": "nothing"}.get(start, f"clone of {start}")


__all__ = [
    "POLICIES",
    "PRETRAINED",
    "DensityCap",
    "Evolved",
    "Follow",
    "HeadwayRule",
    "Policy",
    "RandomWalk",
    "RuleAtShare",
    "ShortestPath",
    "StandStill",
    "YieldWhenStuck",
    "Zipper",
    "load",
    "make_policy",
    "starts_from",
]
