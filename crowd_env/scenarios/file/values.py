"""What the keys of plain data hold: numbers, texts, points, distributions, and tables made from dataclasses."""

import inspect
import math
import re
from collections.abc import Mapping
from dataclasses import MISSING, fields
from numbers import Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import (
    AfterValidator,
    AllowInfNan,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    Strict,
    Tag,
    TypeAdapter,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from crowd_env.core.arrays.outline import Disc
from crowd_env.scenarios.distributions import Distribution, LogNormal, Normal, Uniform
from crowd_env.scenarios.file.errors import nearest
from crowd_env.scenarios.file.expressions import LARGEST


def _number(value: Any) -> Any:
    """Return a number of NumPy as Python's; refuse one that is too large."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, int | float) and LARGEST < abs(value) < math.inf:
        raise ValueError(f"is beyond {LARGEST:g}, the largest number that is read")
    return value


def _whole(value: Any) -> Any:
    value = _number(value)
    return int(value) if isinstance(value, float) and value.is_integer() else value


Text = Annotated[str, Strict()]
Flag = Annotated[bool, Strict()]
Number = Annotated[float, Strict(), AllowInfNan(False), BeforeValidator(_number)]
PerhapsInfinite = Annotated[float, Strict(), BeforeValidator(_number)]
Whole = Annotated[int, Strict(), BeforeValidator(_whole)]
Texts = list[Text]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, content: Any) -> Any:
        known = [field.alias or name for name, field in cls.model_fields.items()]
        for key in content if isinstance(content, Mapping) else ():
            if key not in known:
                advice = {"key": key, "advice": nearest(key, known)}
                raise PydanticCustomError("unknown_key", "unknown key {key}; {advice}", advice)
        return content

    def given(self) -> dict[str, Any]:
        """Return the keys that the table has, with what they hold."""
        return {name: getattr(self, name) for name in type(self).model_fields if name in self.model_fields_set}


def kind_of(value: Any) -> str | None:
    """Return which kind of plain data a value is; None = none of those that a key can choose from."""
    kinds = {str: "text", Mapping: "table", list | tuple: "list", bool: None, Real: "number"}
    return next((name for kind, name in kinds.items() if isinstance(value, kind)), None)


def one_of_kinds(expected: str, kind_of: Any = kind_of) -> Discriminator:
    """Return what chooses among types that are tagged with their kind; ``expected`` says which there are, for errors."""
    return Discriminator(kind_of, custom_error_type="wrong_kind", custom_error_message=expected)


# ----------------------------------------------------------------------------------------------- tables of dataclasses


class FromFields:
    """Annotation of a dataclass that is made of a table, see `table_of`; ``keys`` that are not fields are left out."""

    def __init__(self, **keys: Any) -> None:
        self._keys = keys

    def __get_pydantic_core_schema__(self, made: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema of the table and of what is made of it."""
        names = [field.name for field in fields(made)]

        def make(table: Table) -> Any:
            return made(**{name: value for name, value in table.given().items() if name in names})

        table = handler.generate_schema(table_of(made, **self._keys))
        return core_schema.no_info_after_validator_function(make, table)


def table_of(kind: type, **keys: Any) -> type[Table]:
    """Return the table whose keys are the fields of a dataclass, with the notes of its docstring.

    Parameters
    ----------
    **keys : types of keys that are not fields (these are needed), or differ from them (these may be left out).
    """
    hints, notes = get_type_hints(kind), parameters(kind)
    columns: dict[str, Any] = {name: (read_as, ...) for name, read_as in keys.items() if name not in hints}
    for field in fields(kind):
        read_as = keys.get(field.name) or _read_as(hints[field.name])
        options: dict[str, Any] = {"default_factory": dict}  # no default to show; it is the dataclass that knows
        if isinstance(field.default, str | int | float) and field.default == field.default:  # nan: not given
            options = {"default": field.default}
        elif field.default is MISSING and field.default_factory is MISSING and field.name not in keys:
            options = {}
        if field.name not in keys or get_origin(read_as) is Literal:
            options["description"] = notes.get(field.name)
        columns[field.name] = (read_as, Field(**options))
    return create_model(kind.__name__, __base__=Table, __doc__=_plain((kind.__doc__ or "").split("\n")[0]), **columns)


def parameters(of: type) -> dict[str, str]:
    """Return what the docstring of a class says of each parameter, without references to code."""
    _, _, section = (inspect.getdoc(of) or "").partition("Parameters\n----------\n")
    found: dict[str, str] = {}
    for names, note in re.findall(r"^(\w+(?:, \w+)*) : (.+(?:\n +\S.*)*)", section, re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), _plain(note))
    return found


def _plain(note: str) -> str:
    return re.sub(r",? see `[\w.]+`", "", " ".join(note.replace("``", "`").split()))


def _read_as(annotation: Any) -> Any:
    """Return the type of plain data for the type of a field; what may be None is then left out."""
    if get_origin(annotation) in (Union, UnionType):
        (annotation,) = (one for one in get_args(annotation) if one is not NoneType)
    return annotation if get_origin(annotation) is Literal else _PLAIN[annotation]


# ------------------------------------------------------------------------------------------------------- distributions

Named = Annotated[
    Annotated[Uniform, FromFields(distribution=Literal["uniform"])]
    | Annotated[Normal, FromFields(distribution=Literal["normal"])]
    | Annotated[LogNormal, FromFields(distribution=Literal["lognormal"])],
    Field(discriminator="distribution"),
]
DISTRIBUTION = Annotated[
    Annotated[Number, AfterValidator(lambda value: Uniform(value, value)), Tag("number")]
    | Annotated[Pair, AfterValidator(lambda bounds: Uniform(*bounds)), Tag("list")]
    | Annotated[Named, Tag("table")],
    one_of_kinds("a number, a pair [low, high] (uniform) or a table with the key 'distribution'"),
]

_PLAIN: dict[Any, Any] = {
    str: Text,
    int: Whole,
    float: Number,
    bool: Flag,
    tuple[str, ...]: Texts,
    tuple[Disc, ...]: list[Annotated[list[Number], Field(min_length=3, max_length=3)]],
    Distribution: DISTRIBUTION,
}

distribution_adapter: TypeAdapter[Any] = TypeAdapter(DISTRIBUTION)
