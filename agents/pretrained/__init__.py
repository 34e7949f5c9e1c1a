"""Trained policies that are shipped, by name: ``crowd_env.agents.load("competitive-door/ppo")``.

A policy is two files in the folder of its task, or beside these folders if it is for all places, as ``generalist`` is.
``NAME.safetensors`` is all that acting needs: the weights, and in its header the kind of the network, observation, action and
what it was trained for.  ``NAME.json`` is its card, for people and for papers: how it was trained, and what it reached on
held-out draws.  Nothing is said twice; the card names the weights it is about by their digest.  ``crowd-env ship`` writes both.
"""

from pathlib import Path

from ..trained import NUMBERS, LearnedController, LearnedPolicy, load_trained, names_file

FOLDER = Path(__file__).parent

# Name, TASK/POLICY or generalist -> file of the network: what lies in the folder.
PRETRAINED: dict[str, Path] = {
    path.relative_to(FOLDER).with_suffix("").as_posix(): path for path in sorted(FOLDER.rglob(f"*{NUMBERS}"))
}


def load(name: str) -> LearnedPolicy | LearnedController:
    """Return a trained policy; of a task that decides exits it is a controller.

    Parameters
    ----------
    name : of a shipped policy in `PRETRAINED`, or the path of a network (.safetensors).

    Raises
    ------
    ValueError
        If the name is unknown (the message lists the shipped ones), or the network cannot be read.
    """
    if names_file(name):
        return load_trained(name)
    if name not in PRETRAINED:
        shipped = ", ".join(PRETRAINED) or "none"
        raise ValueError(f"unknown trained policy {name!r}; shipped: {shipped}, or the path of a network ({NUMBERS})")
    found = load_trained(PRETRAINED[name])
    found.name = name
    return found


__all__ = ["PRETRAINED", "load"]
