"""The role of a shape, from the layer of a drawing or a word of a feature."""

import re

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
