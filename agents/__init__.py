"""Who decides: policies over arrays, rule-based and learned, behind one protocol."""

from agents.evolved import Evolved
from agents.policy import Policy
from agents.rules import RandomWalk, ShortestPath, StandStill
from agents.trained import LearnedPolicy, names_file
from agents.walking import DensityCap, Follow, HeadwayRule, RuleAtShare, Zipper

# Name -> policy.  A path to a trained network (.safetensors) is a policy too: see `make_policy`.
POLICIES: dict[str, type[Policy]] = {
    "random": RandomWalk,
    "stand-still": StandStill,
    "shortest": ShortestPath,
    "rule-best-speed": RuleAtShare,
    "density-cap": DensityCap,
    "headway": HeadwayRule,
    "follow": Follow,
    "evolution": Evolved,
    "zipper": Zipper,
}


def make_policy(policy: str | Policy, *, trust_pickle: bool = False) -> Policy:
    """Return a policy by name or from a trained network (a path that ends in .safetensors), or the policy itself.

    Parameters
    ----------
    trust_pickle : open a file of stable-baselines3 (.zip) too.  Opening one runs whatever code its maker put in.

    Raises
    ------
    ValueError
        If the name is unknown, or the network cannot be read.
    """
    if not isinstance(policy, str):
        return policy
    if names_file(policy):
        return LearnedPolicy.load(policy, trust_pickle=trust_pickle)
    if policy not in POLICIES:
        raise ValueError(
            f"unknown policy {policy!r}; known: {', '.join(POLICIES)}, or the path of a network (.safetensors)"
        )
    return POLICIES[policy]()


__all__ = [
    "POLICIES",
    "DensityCap",
    "Evolved",
    "Follow",
    "HeadwayRule",
    "Policy",
    "RandomWalk",
    "RuleAtShare",
    "ShortestPath",
    "StandStill",
    "Zipper",
    "make_policy",
]
