"""The role of a shape, from the layer of a drawing or a word of a feature."""

import re
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TypeAlias

from crowd_env.core.checks import known, texts

# The layers that JuPedSim reads, with or without "jps-"; the text after a dash is a name: jps-exits-north.
_LAYER = re.compile(
    r"(?:.*[$|])?(?:jps[-_ ]?)?(walkable[-_ ]?areas?|obstacles?|exits?|distributions?)(?:[-_ ]+(.*))?", re.IGNORECASE
)
_OF_LAYER = {"w": "walkable", "o": "obstacle", "e": "exit", "d": "start"}
LAYERS = "jps-walkablearea, jps-obstacles, jps-exits and jps-distributions (with or without jps-)"

# Words of a feature, beside the names of layers.
WORDS = {
    "walkable": ("walkable", "floor", "room", "corridor"),
    "obstacle": ("wall", "walls", "column", "columns", "pillar", "pillars", "hole", "holes"),
    "exit": ("emergency exit", "outlet"),
    "start": ("start", "starts", "source", "sources"),
    "region": ("region", "regions", "zone", "zones"),
}
_OF_WORD = {word: role for role, words in WORDS.items() for word in words}


RoleOf: TypeAlias = Callable[[str], tuple[str, str] | None]
"""Returns the role of a layer and the name that it gives, or None."""

# Key of `layers` in a project -> the role of its layers.
CHOICES = {"walkable": "walkable", "obstacles": "obstacle", "exits": "exit", "starts": "start", "regions": "region"}


def chosen_roles(layers: Mapping[str, Sequence[str]]) -> RoleOf:
    """Return the roles that a user has chosen, layers of other names having theirs.

    Parameters
    ----------
    layers : key of `CHOICES` -> names of layers, in any case; ``*`` stands for any letters.

    Raises
    ------
    ValueError
        If a key is unknown, or its names are no list of texts.
    """
    for key in layers:
        known("key of layers", key, CHOICES)
    patterns = [(one.lower(), CHOICES[key]) for key, names in layers.items() for one in texts(f"layers.{key}", names)]

    def role_of(layer: str) -> tuple[str, str] | None:
        found = next((role for pattern, role in patterns if fnmatchcase(layer.lower(), pattern)), None)
        return role_of_layer(layer) if found is None else (found, "")

    return role_of


def role_of_layer(layer: str) -> tuple[str, str] | None:
    """Return the role of a layer, walkable, obstacle, exit or start, and the name that it gives; None = it has none."""
    match = _LAYER.fullmatch(layer.strip())
    return None if match is None else (_OF_LAYER[match[1][0].lower()], (match[2] or "").strip())


def role_of_word(word: str) -> str | None:
    """Return the role that a word of a feature names: a role of a layer, or region; None = no role."""
    of_layer = role_of_layer(word)
    if of_layer is not None and not of_layer[1]:
        return of_layer[0]
    return _OF_WORD.get(re.sub(r"[-_\s]+", " ", word).strip().lower())
