"""Numbers that a scenario file leaves open: ``"{width / 2}"`` with the options of the file; arithmetic and nothing else."""

import ast
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

from crowd_env.scenarios.file.errors import at

# What callers can set of every scenario in a file, whatever options the file declares.
COMMON = ("people", "time_limit", "blocked_after", "target", "population")
LARGEST = 1e15  # of all numbers in a scenario file
_LONGEST = 1000  # characters of an expression

_BRACES = re.compile(r"\{([^{}]*)\}")
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
}


def fill(content: Any, options: Mapping[str, float], path: str = "") -> Any:
    """Return the content of a file with the numbers of ``options`` where texts have braces; ``path`` is its key, for errors.

    Raises
    ------
    ValueError
        If braces are wrong; the message begins with the path of the text, such as ``groups[1].people``.
    """
    match content:
        case str():
            with at(path):
                return fill_in(content, options)
        case dict():
            inside = f"{path}." if path else ""
            return {key: fill(value, options, f"{inside}{key}") for key, value in content.items()}
        case list():
            return [fill(value, options, f"{path}[{k}]") for k, value in enumerate(content)]
    return content


def fill_in(text: str, options: Mapping[str, float]) -> str | float:
    """Return ``text`` with every ``{expression}`` replaced by its value; of a text that is one expression, the number.

    Raises
    ------
    ValueError
        If braces do not match, or an expression holds anything but numbers, options, + - * / // and parentheses.
    """
    rest = _BRACES.sub("", text)
    if "{" in rest or "}" in rest:
        raise ValueError(f"{text!r} has a brace without its partner")
    whole = _BRACES.fullmatch(text)
    if whole:
        return evaluate(whole[1], options)
    return _BRACES.sub(lambda found: f"{evaluate(found[1], options):.10g}", text)


def evaluate(expression: str, options: Mapping[str, float]) -> float:
    """Return the value of an expression such as ``(length - width) / 2``.

    Raises
    ------
    ValueError
        If it holds anything but numbers, options, + - * / // and parentheses, or has no value.
    """
    if len(expression) > _LONGEST:
        raise ValueError(f"{{{expression[:20]}...}} is longer than {_LONGEST} characters")
    try:
        value = _value(ast.parse(expression.strip(), mode="eval").body, options)
        if abs(value) > LARGEST:
            raise OverflowError(f"it is beyond {LARGEST:g}")
        return value
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(f"{{{expression}}} is not an expression of numbers, options, + - * / // and ()") from None
    except (ZeroDivisionError, OverflowError) as error:
        raise ValueError(f"{{{expression}}} has no value: {error}") from None


def _value(node: ast.expr, options: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return number
        case ast.Name(id=name):
            if name not in options:
                raise ValueError(f"unknown option {name!r} in braces; known: {', '.join(options) or 'none'}")
            return options[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, options)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(left, options), _value(right, options))
    raise SyntaxError
