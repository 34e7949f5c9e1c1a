"""What is wrong with plain data, in one sentence that begins with the file and the path of the key in it."""

import difflib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from crowd_env.core.checks import shown

if TYPE_CHECKING:
    from pydantic import TypeAdapter
    from pydantic_core import ErrorDetails

_KINDS = {dict: "a table", list: "a list", tuple: "a list", bool: "true or false", int: "a number", float: "a number"}
_KINDS |= {str: "a text"}
_EXPECTED = {
    "bool_type": "true or false",
    "dict_type": "a table",
    "float_type": "a number",
    "int_type": "a number",
    "list_type": "a list",
    "model_type": "a table",
    "string_type": "a text",
}


@contextmanager
def at(where: str) -> Iterator[None]:
    """Begin any ValueError of the block with ``where``, a file or a key, unless it does so already."""
    try:
        yield
    except ValueError as error:
        message = str(error)
        raise ValueError(message if message.startswith(f"{where}: ") else f"{where}: {message}") from None


def validate(adapter: "TypeAdapter[Any]", content: Any, source: str, path: str = "") -> Any:
    """Return plain data as the type of ``adapter``.

    Parameters
    ----------
    source, path : the file (or the argument) that the content is from, and its key there, for errors.

    Raises
    ------
    ValueError
        If something is wrong: one sentence about the first mistake.
    """
    from pydantic import ValidationError

    try:
        return adapter.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    raise ValueError(_sentence(first, source, _path(first["loc"], content, path)))


def _path(location: Sequence[int | str], content: Any, path: str) -> str:
    """Return a location in ``content`` as ``groups[1].radius``; parts of it that are neither key nor index are left out."""
    for part in location:
        if isinstance(part, str) and isinstance(content, Mapping) and part in content:
            path, content = f"{path}.{part}" if path else part, content[part]
        elif isinstance(part, int) and isinstance(content, list | tuple):
            path, content = f"{path}[{part}]", content[part]
    return path


def _sentence(error: "ErrorDetails", source: str, path: str) -> str:
    """Return what pydantic reports, as one sentence."""
    value, context, inside = error["input"], error.get("ctx", {}), f" in {path}" if path else ""
    match error["type"]:
        case "missing":
            return f"{source}: key {error['loc'][-1]!r} is missing{inside}"
        case "union_tag_not_found":
            return f"{source}: key {context['discriminator']} is missing{inside}"
        case "unknown_key":
            return f"{source}: unknown key {context['key']!r}{inside}; {context['advice']}"
        case "union_tag_invalid":
            path += "." + context["discriminator"].strip("'")
            problem = f"is {shown(context['tag'])}; allowed: {_words(context['expected_tags'])}"
        case "literal_error":
            problem = f"is {shown(value)}; allowed: {_words(context['expected'])}"
        case "too_short" | "too_long":
            problem = f"has {len(value)} values; it must have {context.get('min_length', context.get('max_length'))}"
        case "finite_number":
            problem = f"is {value}; it must be finite"
        case "int_type" if isinstance(value, float):
            problem = f"is {value:g}; it must be a whole number"
        case "wrong_kind":
            problem = f"is {_kind(value)}; it must be {error['msg']}"
        case "value_error":
            problem = str(context["error"])
        case kind:
            problem = f"is {_kind(value)}; it must be {_EXPECTED[kind]}" if kind in _EXPECTED else error["msg"]
    return ": ".join(part for part in (source, path, problem) if part)


def _words(quoted: str) -> str:
    """Return "'a', 'b' or 'c'" as "a, b, c"."""
    return quoted.replace("' or '", "', '").replace("'", "")


def _kind(value: Any) -> str:
    """Return what a value is, in the words of the file."""
    found = _KINDS.get(type(value), f"a {type(value).__name__}")
    return found + (f" ({shown(value)})" if isinstance(value, str | bool | int | float) else "")


def nearest(name: str, known: Collection[str]) -> str:
    """Return the advice about an unknown name: the one that was probably meant, or all there are."""
    close = difflib.get_close_matches(str(name), known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known: {', '.join(known)}"
