"""Checks of what callers give: one sentence that says what is wrong, where, and what is allowed; always a ValueError.

Numbers may be Python's or NumPy's; what is returned is Python's.  True and False are no numbers, and a text is no list of
letters.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, asdict, fields, is_dataclass
from functools import cache
from numbers import Real
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    NoReturn,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)
from unicodedata import category

import numpy as np

Thing = TypeVar("Thing")
Plain: TypeAlias = Mapping[str, Any]
"""Plain data, as JSON and TOML hold it."""

_LONGEST = 60  # letters of a value in a message


class Range(NamedTuple):
    """Which numbers are allowed: from ``low`` (or only above it) to ``high``."""

    low: float = -math.inf
    high: float = math.inf
    above: bool = False  # ``low`` itself is not allowed
    infinite: bool = False  # infinity is allowed
    why: str = ""  # the reason or formula, for the message

    def __contains__(self, value: object) -> bool:
        """Return whether a number is allowed; nan never is."""
        try:
            size = float(value)  # type: ignore[arg-type]  # a number of any kind
        except OverflowError:
            return False
        if not (math.isfinite(size) or (self.infinite and size == math.inf)):
            return False
        size = value if isinstance(value, int) else size  # a float may lose digits of it
        return (self.low < size if self.above else self.low <= size) and size <= self.high

    def __get_pydantic_json_schema__(self, core: Any, schema_of: Any) -> dict[str, Any]:
        """Return the JSON Schema of an annotated number."""
        return {**schema_of(core), **self.in_schema()}

    def in_schema(self) -> dict[str, float]:
        """Return the bounds in the words of JSON Schema."""
        bounds = {"exclusiveMinimum" if self.above else "minimum": self.low, "maximum": self.high}
        return {name: bound for name, bound in bounds.items() if math.isfinite(bound)}

    def because(self, why: str) -> "Range":
        """Return the same numbers with a reason, which ends the message."""
        return self._replace(why=why)

    def __str__(self) -> str:
        """Say it as the end of "it must be"."""
        if self.high < math.inf:
            return (
                f"above {self.low:g} and at most {self.high:g}" if self.above else f"in [{self.low:g}, {self.high:g}]"
            )
        if self.low == -math.inf:
            return "finite"
        return f"{'>' if self.above else '>='} {self.low:g}{'' if self.infinite else ' and finite'}"


FINITE = Range()
POSITIVE = Range(0.0, above=True)
NOT_NEGATIVE = Range(0.0)
SHARE = Range(0.0, 1.0)
COUNT = Range(1)

# Annotations of fields that `check_fields` understands.
Positive = Annotated[float, POSITIVE]
NotNegative = Annotated[float, NOT_NEGATIVE]
Share = Annotated[float, SHARE]
Natural = Annotated[int, NOT_NEGATIVE]


def shown(value: Any) -> str:
    """Return a value as messages show it: short, in one line, an array by its shape."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of shape {value.shape} and type {value.dtype}"
    if isinstance(value, np.generic | np.ndarray):
        value = value.item()
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def counted(count: int, one: str, many: str) -> str:
    """Return "1 run", "2 runs"."""
    return f"{count} {one if count == 1 else many}"


def refuse(what: str, value: Any, allowed: str) -> NoReturn:
    """Raise the ValueError that says what ``what`` is and what is allowed."""
    raise ValueError(f"{what} is {shown(value)}; it must be {allowed}")


@contextmanager
def at(where: str) -> Iterator[None]:
    """Begin any ValueError of the block with ``where``, a file or a key, unless it does so already."""
    try:
        yield
    except ValueError as error:
        message = str(error)
        raise ValueError(message if message.startswith(f"{where}: ") else f"{where}: {message}") from None


def number(what: str, value: Any, allowed: Range = FINITE, unit: str = "") -> float:
    """Return a number as a float.

    Raises
    ------
    ValueError
        If it is no number, not finite, or not ``allowed``.
    """
    why = allowed.why and f": {allowed.why}"
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        refuse(what, value, f"a number{'' if allowed == FINITE else f', {allowed}'}{why}")
    if value not in allowed:
        raise ValueError(f"{what} is {shown(value)}{unit and ' '}{unit}; it must be {allowed}{why}")
    return float(value)


def whole(what: str, value: Any, allowed: Range = COUNT) -> int:
    """Return a whole number as an int; 20.0 is one.

    Raises
    ------
    ValueError
        If it is no whole number, or not ``allowed``.
    """
    bounds = f"{allowed.low:.0f} to {allowed.high:.0f}" if allowed.high < math.inf else f"at least {allowed.low:.0f}"
    why = allowed.why and f": {allowed.why}"
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real) or value not in FINITE or float(value) % 1.0:
        refuse(what, value, f"a whole number, {bounds}{why}")
    if value not in allowed:
        refuse(what, value, f"{bounds}{why}")
    return int(value)  # type: ignore[call-overload]  # a real number that is whole


def flag(what: str, value: Any) -> bool:
    """Return True or False; nothing else is taken for one of them.

    Raises
    ------
    ValueError
        If it is something else.
    """
    if not isinstance(value, bool | np.bool_):
        refuse(what, value, "True or False")
    return bool(value)


def text(what: str, value: Any, allowed: str = "a text") -> str:
    """Return a text.

    Raises
    ------
    ValueError
        If it is something else.
    """
    if not isinstance(value, str):
        refuse(what, value, allowed)
    return str(value)


def plain_name(what: str, value: Any) -> str:
    """Return a name without blanks at its ends.

    Raises
    ------
    ValueError
        If nothing is left, or it holds line breaks or other control characters, which cut the rows of tables.
    """
    name = str(value).strip()
    if not name or any(category(letter) in ("Cc", "Cs", "Zl", "Zp") for letter in name):
        refuse(what, value, "a text without line breaks and control characters, and not empty")
    return name


def path(what: str, value: Any) -> Path:
    """Return the path of a file, given as a text or a path.

    Raises
    ------
    ValueError
        If it is something else.
    """
    if not isinstance(value, str | Path):
        refuse(what, value, "the path of a file")
    return Path(value)


def texts(what: str, value: Any) -> tuple[str, ...]:
    """Return names as a tuple; a single text is not taken for its letters.

    Raises
    ------
    ValueError
        If it is no list of texts.
    """
    names: tuple[str, ...] = _read(what, value, tuple[str, ...], None)
    return names


def table(what: str, value: Any, of: str) -> Plain:
    """Return a table; ``of`` says from what to what.

    Raises
    ------
    ValueError
        If it is something else.
    """
    if not isinstance(value, Mapping):
        refuse(what, value, f"a table of {of}")
    return value


# Kind -> its names; each registry enters its own, so that a name of another kind is answered so.
NAMES: dict[str, Collection[str]] = {}


def of_another_kind(value: Any, *kinds: str) -> str:
    """Return what a name is that is none of these ``kinds``, to end a message with; "" if nothing has the name."""
    found = [kind for kind, names in NAMES.items() if kind not in kinds and isinstance(value, str) and value in names]
    return f"; {value!r} is a {' and a '.join(found)}" if found else ""


def known(what: str, value: Any, names: Iterable[str], where: str = "") -> str:
    """Return a name that is one of ``names``; ``where`` begins the message.

    Raises
    ------
    ValueError
        If it is not; the message lists them.
    """
    names = list(names)
    if not isinstance(value, str) or value not in names:
        said = of_another_kind(value, what)
        raise ValueError(f"{where}unknown {what} {shown(value)}; known: {', '.join(names) or 'none'}{said}")
    return str(value)


def array(what: str, value: Any, shape: tuple[Any, ...], kinds: str = "iuf") -> np.ndarray:
    """Return an array of numbers of this shape; None = any length, ... (first) = any dimensions before the others.

    Raises
    ------
    ValueError
        If it has another shape, or holds something else (``kinds`` as in ``numpy.dtype.kind``).
    """
    if isinstance(value, np.ndarray) and value.shape == shape and value.dtype.kind in kinds:
        return value  # at every step: quick
    names = {None: "K", ...: "..."}
    told = f"({', '.join(names.get(length, str(length)) for length in shape)}{',' * (len(shape) == 1)})"
    of = "booleans" if kinds == "b" else "real numbers"
    form = f"an array of {of} of the shape {told}" if shape else "a real number"
    try:
        found = np.asarray(value)
        if found.dtype == object:  # numbers one by one, or something else altogether
            found = np.asarray(found.tolist())
    except (TypeError, ValueError):  # rows of different lengths
        refuse(what, value, form)
    wanted = (*(None,) * (found.ndim - len(shape) + 1), *shape[1:]) if shape[:1] == (...,) else shape
    if found.dtype.kind not in kinds or (shape and found.ndim == 0):
        refuse(what, value, form)
    if found.ndim != len(wanted) or any(
        one not in (None, there) for one, there in zip(wanted, found.shape, strict=True)
    ):
        raise ValueError(f"{what} has the shape {found.shape}; it must be {told}")
    return found


def require_all(what: str, values: np.ndarray, allowed: Range) -> np.ndarray:
    """Return an array of numbers; raise ValueError, naming the first that is not, unless all are allowed."""
    inside = (values > allowed.low if allowed.above else values >= allowed.low) & (values <= allowed.high)
    good = inside & np.isfinite(values)
    if not good.all():
        bad = np.argwhere(~good)
        refuse(f"{what}[{', '.join(map(str, bad[0]))}]", values[tuple(bad[0])], str(allowed))
    return values


# ----------------------------------------------------------------------------------------------------- dataclasses


def check_fields(where: str, thing: Any, **allowed: Range) -> None:
    """Check every field of a frozen dataclass against its annotation, and give it the type that is annotated.

    Numbers, flags, texts, literals, other dataclasses, tuples of these, and these or None are known; other annotations are
    left to the caller.  A number whose annotation holds a `Range`, such as ``Positive``, has to lie in it.  For another
    dataclass a table of its fields may be given.

    Parameters
    ----------
    where : begins the message.
    allowed : of numbers, by the name of the field; finite if not said.

    Raises
    ------
    ValueError
        At the first field that does not hold what it says.
    """
    of_class: type = type(thing)
    for name, (kind, default) in _fields(of_class).items():
        before, within = getattr(thing, name), allowed.get(name)
        if before is not default or within is not None:
            value = _read(f"{where}: {name}" if where else name, before, kind, within)
            if value is not before:
                object.__setattr__(thing, name, value)


class Checked:
    """Base of dataclasses whose fields are checked at construction; messages begin with the name of the class."""

    def __post_init__(self) -> None:
        check_fields(type(self).__name__.lower(), self)


@cache
def _fields(of: type) -> dict[str, tuple[Any, Any]]:
    """Return name -> annotation and default of the fields of a dataclass."""
    hints = get_type_hints(of, include_extras=True)
    return {field.name: (hints[field.name], field.default) for field in fields(of) if field.init}


def _is_plain(value: Any, kind: Any, within: Range | None) -> bool:
    """Return whether a value is plainly what an annotation says, or the annotation is left to the caller."""
    origin, args = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _is_plain(value, *args)
    if origin in (UnionType, Union):
        return any(_is_plain(value, one, within) for one in args)
    if origin is tuple:
        return type(value) is tuple and all(_is_plain(one, args[0], None) for one in value)
    if origin is Literal:
        return type(value) is str and value in args
    if kind in _CHECKS:
        within = within or _USUAL.get(kind)
        return type(value) is kind and (within is None or value in within)
    return type(value) is kind or not (kind is NoneType or is_dataclass(kind))


def _read(what: str, value: Any, kind: Any, within: Range | None) -> Any:
    """Return a value as an annotation says; pydantic is loaded for the first one that is not plainly so."""
    if _is_plain(value, kind, within):
        return value
    try:
        return _reader(kind, within).validate_python(value)
    except ValueError as error:
        raise ValueError(_sentence(what, kind, error)) from None


@cache
def _reader(kind: Any, within: Range | None) -> Any:
    from pydantic import TypeAdapter

    return TypeAdapter(_read_as(kind, within))


def _read_as(kind: Any, within: Range | None) -> Any:
    """Return an annotation as pydantic reads it: numbers, flags and texts by the checks above, tables as their dataclass."""
    from pydantic import BeforeValidator, InstanceOf, PlainValidator

    origin, args = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _read_as(*args)
    if origin in (UnionType, Union):
        return Union[tuple(_read_as(one, within) for one in args)]  # noqa: UP007  # as many as there are
    if origin is tuple:
        return origin[_read_as(args[0], None), ...]
    if kind in _CHECKS:
        given = (within,) if within else ()
        return Annotated[kind, PlainValidator(lambda value: _CHECKS[kind]("", value, *given))]
    if not is_dataclass(kind):
        return kind
    of_class: Any = kind
    instance: Any = InstanceOf
    reads = hasattr(kind, "__post_init__")  # it checks its fields
    return Annotated[
        instance[kind],
        BeforeValidator(
            lambda value: from_table("", of_class, value) if reads and isinstance(value, Mapping) else value
        ),
    ]


def _sentence(what: str, kind: Any, refused: Any) -> str:
    """Return in a sentence what pydantic refused first."""
    errors = refused.errors()
    value, context = errors[0]["input"], errors[0].get("ctx", {})
    what += "".join(f"[{k}]" for k in errors[0]["loc"] if isinstance(k, int))
    if "error" in context:  # of a check, which does not know where it is
        message = str(context["error"])
        return what + message if message.startswith((" ", ":")) else message
    if "expected" in context:
        where, colon, name = what.rpartition(": ")
        names = context["expected"].replace(" or ", ", ").replace("'", "")
        return f"{where}{colon}unknown {name} {shown(value)}; known: {names}{of_another_kind(value, name)}"
    if "class" in context:
        must = " or ".join(dict.fromkeys(f"a {one['ctx']['class']}" for one in errors))
        must += ", and not a list of them" * isinstance(value, list)
    else:
        of = get_args(kind)[0]
        example = f": ({value!r},)" if of is str and isinstance(value, str) else ""
        must = f"a tuple of {'names' if of is str else f'{of.__name__} objects'}{example}"
    return f"{what} is {shown(value)}; it must be {must}"


_CHECKS: dict[Any, Any] = {float: number, int: whole, bool: flag, str: text}
_USUAL = {float: FINITE, int: COUNT}


def from_table(where: str, kind: type[Thing], table: Plain) -> Thing:
    """Return a dataclass made of plain data; the keys are the names of its fields.

    Raises
    ------
    ValueError
        If a key is unknown (the message lists the known ones) or missing, or what the class refuses.
    """
    of_class = fields(kind)  # type: ignore[arg-type]  # a dataclass
    check_keys(where, table, [field.name for field in of_class])
    for field in of_class:
        if field.name not in table and field.default is MISSING and field.default_factory is MISSING:
            raise ValueError(f"{where}: key {field.name!r} is missing")
    return kind(**table)


def from_data(what: str, kind: type[Thing], value: Any, allowed: str) -> Thing:
    """Return a dataclass that is given as an object, as plain data, or as None: then its defaults.

    Raises
    ------
    ValueError
        If it is something else, saying what is ``allowed``, or for what `from_table` refuses.
    """
    if value is None:
        return kind()
    if isinstance(value, Mapping):
        return from_table(what, kind, value)
    if not isinstance(value, kind):
        refuse(what, value, allowed)
    return value


def from_choice(what: str, kind: type[Thing], value: Any, choices: Mapping[str, Thing | None]) -> Thing | None:
    """Return a dataclass that is given as an object, as plain data, as a name in ``choices``, or as None: none.

    Raises
    ------
    ValueError
        If it is something else, an unknown name (the message lists the known ones), or for what `from_table` refuses.
    """
    if isinstance(value, str):
        return choices[known(what, value, choices)]
    article = "an" if kind.__name__[0] in "AEIOU" else "a"
    allowed = f"{article} {kind.__name__}, a table of its parameters, None or one of {', '.join(choices)}"
    return None if value is None else from_data(what, kind, value, allowed)


def plain_choice(thing: Any, choices: Mapping[str, Any]) -> str | dict[str, Any]:
    """Return the name that a dataclass has in ``choices``, else the table of its fields: what `from_choice` takes."""
    return next((name for name, choice in choices.items() if thing == choice), None) or asdict(thing)


def check_keys(where: str, table: Plain, names: Collection[str]) -> None:
    """Raise ValueError, listing the known ones, if a key of plain data is not among ``names``."""
    for key in table:
        if key not in names:
            raise ValueError(f"{where}: unknown key {shown(key)}; known: {', '.join(names)}")
