"""The role of a shape, from the layer of a drawing or the words of a feature."""

import re
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple, TypeAlias

from crowd_env.core.checks import known, table, texts

# The layers that JuPedSim reads, with or without "jps-"; the text after a dash is a name: jps-exits-north.
_LAYER = re.compile(
    r"(?:.*[$|])?(?:jps[-_ ]?)?(walkable[-_ ]?areas?|obstacles?|exits?|distributions?)(?:[-_ ]+(.*))?", re.IGNORECASE
)
_OF_LAYER = {"w": "walkable", "o": "obstacle", "e": "exit", "d": "start"}
LAYERS = "jps-walkablearea, jps-obstacles, jps-exits and jps-distributions (with or without jps-)"

# Words of a feature, beside the names of layers.  Only the edges of rooms may be walls; a building is floor if nothing else is.
WORDS = {
    "walkable": ("walkable", "floor", "corridor", "walkway", "hallway", "hall", "lobby"),
    "room": ("room",),
    "door": ("door", "doors"),
    "obstacle": ("wall", "walls", "column", "columns", "pillar", "pillars", "hole", "holes", "window", "windows"),
    "exit": ("emergency exit", "outlet"),
    "start": ("start", "starts", "source", "sources"),
    "region": ("region", "regions", "zone", "zones"),
    "stairs": ("stairs", "staircase", "steps", "escalator"),
    "ramp": ("ramp",),
    "elevator": ("elevator", "elevators", "lift"),
    "building": ("building", "building outline", "footprint"),
}
_OF_WORD = {word: role for role, words in WORDS.items() for word in words}
_OWN = ("role", "kind", "type", "layer", "class", "category", "usage", "function")

# Key of OpenStreetMap -> value -> role; "*" = any other, "" = no meaning.  See its page Simple Indoor Tagging.
OSM = {
    "highway": {"steps": "stairs", "elevator": "elevator"},
    "stairs": {"yes": "stairs", "no": ""},
    "room": {"stairs": "stairs", "elevator": "elevator"},
    "entrance": {"no": "", "*": "entrance"},
    "exit": {"no": "", "*": "entrance"},
    "door": {"*": "door"},  # door=no is an opening without a leaf
    "indoor": {
        **{"room": "room", "area": "walkable", "corridor": "walkable"},
        **{"wall": "obstacle", "column": "obstacle", "door": "door", "level": "building"},
    },
    "building": {"no": "", "*": "building"},
}
_ON_EDGES = ("entrance", "exit", "door")  # keys that say nothing about an area
_RELATIONS = ("multipolygon", "boundary", "site")  # types in OpenStreetMap

# feature_type of IMDF 1.0.0 (OGC 20-094), beside units -> role; "nothing" = it only describes.
IMDF = {
    **{"opening": "opening", "fixture": "obstacle", "kiosk": "obstacle"},
    **dict.fromkeys(("address", "amenity", "anchor", "building", "detail", "footprint", "geofence"), "nothing"),
    **dict.fromkeys(("level", "manifest", "occupant", "relationship", "section", "venue"), "nothing"),
}
# Category of a unit -> role, if it is no room.
UNITS = {
    **{"stairs": "stairs", "steps": "stairs", "escalator": "stairs", "elevator": "elevator", "ramp": "ramp"},
    **dict.fromkeys(("nonpublic", "structure", "opentobelow", "vegetation"), "obstacle"),
    **dict.fromkeys(("brick", "column", "concrete", "drywall", "glass", "wood"), "obstacle"),
}
FIRST_EXITS = ("emergencyexit", "pedestrian.principal")  # categories of openings


class Said(NamedTuple):
    """What the properties of a feature say of it."""

    role: str  # "" = none, or none that is known
    name: str  # that a layer gives
    words: str  # key=value, as written; "" if no property has a role


Chosen: TypeAlias = Callable[[str], str | None]
"""Returns the role that a user has chosen for a layer, "" = it is left out; None = it has that of its name."""

# Key of `layers` in a project -> the role of its layers.
CHOICES = {
    **{"walkable": "walkable", "obstacles": "obstacle", "exits": "exit", "doors": "door"},
    **{"starts": "start", "regions": "region", "left_out": ""},
}


_SHOWN = 24  # layers in a message


def by_names(layer: str) -> None:
    """Choose nothing."""


class ChosenRoles:
    """The roles that a user has chosen for layers; it remembers the layers that it was asked for.

    Parameters
    ----------
    layers : key of `CHOICES` -> names of layers, in any case; ``*`` stands for any letters.

    Raises
    ------
    ValueError
        If a key is unknown, or its names are no list of texts.
    """

    def __init__(self, layers: Mapping[str, Sequence[str]]) -> None:
        for key in table("layers", layers, "roles and names of layers"):
            known("key of layers", key, CHOICES)
        self._names = [(key, one) for key, names in layers.items() for one in texts(f"layers.{key}", names)]
        self._asked: dict[str, None] = {}

    def __call__(self, layer: str) -> str | None:
        """Return the role of a layer, "" = it is left out, None = nothing is chosen for it."""
        self._asked[layer] = None
        return next((CHOICES[key] for key, name in self._names if fnmatchcase(layer.lower(), name.lower())), None)

    def require_all(self) -> None:
        """Raise ValueError if a name is that of no layer."""
        for key, name in self._names:
            if self._asked and not any(fnmatchcase(layer.lower(), name.lower()) for layer in self._asked):
                there = ", ".join(list(self._asked)[:_SHOWN])
                raise ValueError(f"layers.{key} names {name!r}, and it has no such layer; its layers: {there}")


def role_of_layer(layer: str) -> tuple[str, str] | None:
    """Return the role of a layer, walkable, obstacle, exit or start, and the name that it gives; None = it has none."""
    match = _LAYER.fullmatch(layer.strip())
    return None if match is None else (_OF_LAYER[match[1][0].lower()], (match[2] or "").strip())


def role_of_word(word: str) -> str | None:
    """Return the role that a word of a feature names, one of `WORDS`; None = no role."""
    of_layer = role_of_layer(word)
    if of_layer is not None and not of_layer[1]:
        return of_layer[0]
    return _OF_WORD.get(re.sub(r"[-_\s]+", " ", word).strip().lower())


def role_of_feature(table: Mapping[str, Any], feature_type: object, area: bool) -> Said:
    """Return what the first property with a known word means; without one, the last word that is not known.

    Parameters
    ----------
    table : properties.
    feature_type : of IMDF; None = another format.
    area : whether the feature has a polygon.
    """
    if isinstance(feature_type, str):
        imdf = UNITS.get(str(table.get("category")), "room") if feature_type == "unit" else IMDF.get(feature_type, "")
        return Said(imdf, "", f"feature_type={feature_type}")
    unknown = ""
    for key in (*_OWN, *OSM):
        for own, word in table.items():
            if own.lower() != key or not isinstance(word, str) or (area and key in _ON_EDGES):
                continue
            role, name = _role(key, word)
            if role:
                return Said(role, name, f"{own}={word}")
            if role is None and re.search(r"[^\W\d_]", word):  # a number has no meaning
                unknown = f"{own}={word}"
    return Said("", "", unknown)


def _role(key: str, word: str) -> tuple[str | None, str]:
    """Return the role of a word and the name that it gives; "" = no meaning, None = it is not known."""
    if key in OSM:
        words = OSM[key]
        return words.get(word.strip().lower(), words.get("*")), ""
    if key == "type" and word in _RELATIONS:
        return "", ""
    role = role_of_word(word)
    layer = role_of_layer(word) if key == "layer" else None
    return layer if role is None and layer is not None else (role, "")
