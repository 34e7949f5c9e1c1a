"""Fields of frozen dataclasses: what an annotation takes, what it refuses in one sentence, and when pydantic is loaded."""

import subprocess
import sys
from dataclasses import astuple, dataclass, fields, replace
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from cases import looped
from repository import ROOT

from crowd_env.core.behaviors.balance import Balance
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.pulls import GroupCohesion
from crowd_env.core.checks import NOT_NEGATIVE, Positive, Range, Share, check_fields
from crowd_env.physics.social_force import SocialForce
from crowd_env.routing.speed_map import Comfort


@dataclass(frozen=True)
class Part:
    """A part of a machine."""

    size: Positive = 1.0
    load: float = 0.0

    def __post_init__(self) -> None:
        check_fields("part", self, load=NOT_NEGATIVE)


@dataclass(frozen=True)
class Machine:
    """What has a field of every kind."""

    power: float = 1.0
    share: Share = 0.5
    reach: Annotated[float, Range(0.0, infinite=True)] | None = None
    wheels: int = 4
    spare: Annotated[int, Range(0, 3)] | None = None
    quiet: bool = False
    name: str = "a"
    drive: Literal["belt", "chain"] = "belt"
    owners: tuple[str, ...] = ()
    part: Part = Part()
    parts: tuple[Part, ...] = ()
    other: Any = None

    def __post_init__(self) -> None:
        check_fields("machine", self)


TAKEN = [
    ("power", 3, 3.0),
    ("power", np.float32(0.5), 0.5),
    ("power", np.int64(3), 3.0),
    ("reach", np.inf, np.inf),
    ("reach", np.float64(2.0), 2.0),
    ("wheels", 20.0, 20),
    ("wheels", np.float64(20.0), 20),
    ("wheels", np.int32(6), 6),
    ("spare", 0, 0),
    ("spare", None, None),
    ("quiet", np.bool_(True), True),
    ("owners", ["b", "c"], ("b", "c")),
    ("owners", (name for name in "bc"), ("b", "c")),
    ("drive", "chain", "chain"),
    ("part", {"size": 2}, Part(2.0)),
    ("parts", [{"load": 3}, Part(4.0)], (Part(load=3.0), Part(4.0))),
    ("other", {"left": "alone"}, {"left": "alone"}),
]


@looped(("name", "given", "read"), TAKEN)
def test_a_field_has_the_type_of_its_annotation(name, given, read):
    value = getattr(Machine(**{name: given}), name)
    assert value == read and type(value) is type(read)


REFUSED = [
    ({"power": True}, "machine: power is True; it must be a number"),
    ({"power": "3"}, "machine: power is '3'; it must be a number"),
    ({"power": np.nan}, "machine: power is nan; it must be finite"),
    ({"share": 2}, "machine: share is 2; it must be in [0, 1]"),
    ({"share": None}, "machine: share is None; it must be a number, in [0, 1]"),
    ({"reach": -np.inf}, "machine: reach is -inf; it must be >= 0"),
    ({"wheels": 1.5}, "machine: wheels is 1.5; it must be a whole number, at least 1"),
    ({"wheels": np.True_}, "machine: wheels is True; it must be a whole number, at least 1"),
    ({"wheels": 0}, "machine: wheels is 0; it must be at least 1"),
    ({"spare": 4}, "machine: spare is 4; it must be 0 to 3"),
    ({"quiet": 1}, "machine: quiet is 1; it must be True or False"),
    ({"name": b"a"}, "machine: name is b'a'; it must be a text"),
    ({"drive": "shaft"}, "machine: unknown drive 'shaft'; known: belt, chain"),
    ({"drive": 3}, "machine: unknown drive 3; known: belt, chain"),
    ({"owners": "bc"}, "machine: owners is 'bc'; it must be a tuple of names: ('bc',)"),
    ({"owners": ["b", 3]}, "machine: owners[1] is 3; it must be a text"),
    ({"part": 3}, "machine: part is 3; it must be a Part"),
    ({"part": {"sise": 3}}, "machine: part: unknown key 'sise'; known: size, load"),
    ({"part": {"load": -1}}, "part: load is -1; it must be >= 0 and finite"),
    ({"parts": 3}, "machine: parts is 3; it must be a tuple of Part objects"),
    ({"parts": [Part(), 3, 4]}, "machine: parts[1] is 3; it must be a Part"),
    ({"parts": [{"size": 0}]}, "part: size is 0; it must be > 0 and finite"),
]


@looped(("given", "message"), REFUSED)
def test_a_wrong_field_is_one_sentence(given, message):
    with pytest.raises(ValueError) as error:
        Machine(**given)
    assert str(error.value) == message


@looped("kind", [Balance, Comfort, GroupCohesion, Headway, SocialForce])
def test_defaults_are_what_their_annotations_say(kind):
    """A default is not checked when an object is made."""
    usual = kind()
    names = [field.name for field in fields(kind)]
    given = kind(**{name: np.float64(value) for name, value in zip(names, astuple(usual), strict=True)})
    assert given == usual == replace(usual) and all(type(value) is float for value in astuple(given))


def test_pydantic_is_loaded_for_the_first_value_that_is_not_plain():
    program = (
        "import sys; from crowd_env import make_scenario; from crowd_env.core.behaviors.headway import Headway; "
        "make_scenario('room-v0'); print('pydantic' in sys.modules); Headway(time_gap=1); print('pydantic' in sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "True"]


def test_no_digit_of_a_whole_number_is_lost():
    seeds = Range(0, 2**62)
    assert 2**62 in seeds and 2**62 + 1 not in seeds and 10**400 not in seeds and -1 not in seeds
    assert np.int64(2**62) in seeds and 2.0**62 in seeds
