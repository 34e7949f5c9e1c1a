"""Who decides: policies over arrays, rule-based and learned, behind one protocol."""

from agents.policy import Policy
from agents.rules import RandomWalk, ShortestPath, StandStill

# Name -> policy.  A path to a model (.zip) is a policy too: see `make_policy`.
POLICIES: dict[str, type[Policy]] = {
    "random": RandomWalk,
    "stand-still": StandStill,
    "shortest": ShortestPath,
}


def make_policy(policy: str | Policy) -> Policy:
    """Return a policy by name or from a saved model (a path that ends in .zip), or the policy itself.

    Raises
    ------
    ValueError
        If the name is unknown, or the model cannot be read.
    """
    if not isinstance(policy, str):
        return policy
    if policy.endswith(".zip"):
        from agents.learned import LearnedPolicy

        return LearnedPolicy.load(policy)
    if policy not in POLICIES:
        raise ValueError(f"unknown policy {policy!r}; known: {', '.join(POLICIES)}, or the path of a model (.zip)")
    return POLICIES[policy]()


__all__ = ["POLICIES", "Policy", "RandomWalk", "ShortestPath", "StandStill", "make_policy"]
