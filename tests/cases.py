"""One test for many cases: every case that fails is reported by its name, and the suite keeps a size that can be read."""

import inspect
from collections.abc import Callable, Iterable
from typing import Any


def looped(
    names: str | tuple[str, ...], cases: Iterable[Any], ids: Callable[[Any], str] | list[str] | None = None
) -> Any:
    """Return a decorator that runs a test for each case, as ``pytest.mark.parametrize`` would, under one id.

    Cases share the fixtures of the test: take ``parametrize`` where a case changes what a fixture gives.

    Parameters
    ----------
    names : arguments that a case gives, as for ``parametrize``.
    cases : values of the arguments, or a tuple of them for each case.
    ids : names of the cases, or what makes one of a value.
    """
    words = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    cases = list(cases)
    values = [dict(zip(words, case if len(words) > 1 else (case,), strict=True)) for case in cases]
    if ids is None:
        called = [", ".join(f"{word}={value!r}" for word, value in case.items()) for case in values]
    else:
        called = [str(ids(case)) for case in cases] if callable(ids) else [str(name) for name in ids]

    def decorate(test: Callable[..., Any]) -> Callable[..., Any]:
        # A loop around a loop is one loop over all pairs.
        once, inner = getattr(test, "looped", (test, [("", {})]))
        pairs = [
            (", ".join(filter(None, [name, within])), {**case, **part})
            for name, case in zip(called, values, strict=True)
            for within, part in inner
        ]

        def run(subtests: Any, **fixtures: Any) -> None:
            assert pairs, "no case to run"
            for name, case in pairs:
                with subtests.test(msg=name):
                    once(**case, **fixtures)

        signature = inspect.signature(test)
        kept = [p for name, p in signature.parameters.items() if name not in {*words, "subtests"}]
        first = inspect.Parameter("subtests", inspect.Parameter.KEYWORD_ONLY)
        kept = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in kept]
        run.__dict__.update(test.__dict__)  # marks
        run.__signature__ = signature.replace(parameters=[first, *kept])  # type: ignore[attr-defined]
        run.__name__, run.__doc__, run.__module__ = test.__name__, test.__doc__, test.__module__
        run.looped = (once, pairs)  # type: ignore[attr-defined]
        return run

    return decorate
