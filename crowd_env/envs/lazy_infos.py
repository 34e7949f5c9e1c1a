"""The infos of a `ParallelEnv`: a dictionary per agent, written when one of them is read."""

from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any

from crowd_env.core.arrays.state import Ints


class LazyInfos(dict[str, dict[str, Any]]):
    """The infos of a step, a dictionary whose values are written when they are first read.

    Few loops read infos, and writing them takes as long as the other four dictionaries together.  The keys are there at once,
    since C code, as that of json, takes the length without calling a method.  Copies and pickles are plain dictionaries.

    Parameters
    ----------
    keys : a dictionary with the keys, or, without ``write``, whatever ``dict`` takes.
    write : returns the dictionary that it is to become.
    """

    def __init__(self, keys: Any = (), write: Callable[[], dict[str, dict[str, Any]]] | None = None) -> None:
        super().__init__(keys)
        self._write = write

    def fill(self) -> None:
        """Write the values, unless they are written."""
        if self._write is not None:
            write, self._write = self._write, None
            dict.update(self, write())

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


def _filled_first(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method of dictionaries that fills `LazyInfos` before it reads or changes them."""

    @wraps(method)
    def fill_and_call(*args: Any, **kwargs: Any) -> Any:
        for infos in args:  # self, and what it is compared or merged with
            if isinstance(infos, LazyInfos):
                infos.fill()
        return method(*args, **kwargs)

    return fill_and_call


_OF_KEYS = {"__contains__", "__len__", "__sizeof__"}
_OF_THE_CLASS = {"__class_getitem__", "__getattribute__", "__init__", "__new__", "fromkeys"}
for _name, _method in vars(dict).items():
    if callable(_method) and _name not in _OF_KEYS | _OF_THE_CLASS:
        setattr(LazyInfos, _name, _filled_first(_method))


def write_infos(agents: Iterable[str], slots: Ints | slice, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return for each agent the terms of its reward and, if the episode is over, the metrics."""
    terms = {name: values[slots].tolist() for name, values in info.items() if name.startswith("reward/")}
    rows = (dict(zip(terms, row, strict=True)) for row in zip(*terms.values(), strict=True))
    infos: dict[str, dict[str, Any]] = dict(zip(agents, rows, strict=True))
    for metrics in info["metrics"].values():
        for agent in agents:
            infos[agent]["metrics"] = metrics._asdict()
    return infos
