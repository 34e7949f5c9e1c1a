"""One test for many cases: every case that fails is reported by its name, and the suite keeps a size that can be read."""

import inspect
from collections.abc import Callable, Iterable
from typing import Any

import pytest


def looped(
    names: str | tuple[str, ...],
    cases: Iterable[Any],
    ids: Callable[[Any], str] | list[str] | None = None,
    quick: int | None = None,
) -> Any:
    """Return a decorator that runs a test for each case, as ``pytest.mark.parametrize`` would, under one id.

    Cases share the fixtures of the test: take ``parametrize`` where a case changes what a fixture gives.

    Parameters
    ----------
    names : arguments that a case gives, as for ``parametrize``.
    cases : values of the arguments, or a tuple of them for each case.
    ids : names of the cases, or what makes one of a value.
    quick : how many of the first cases ``make test`` runs; all others are marked ``more``.  Without it, it runs all.
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
        once, inner = getattr(test, "looped", (test, [("", {}, True)]))
        pairs = [
            (", ".join(filter(None, [name, within])), {**case, **part}, at_once and (quick is None or k < quick))
            for k, (name, case) in enumerate(zip(called, values, strict=True))
            for within, part, at_once in inner
        ]

        def run(subtests: Any, extent: str = "", **fixtures: Any) -> None:
            chosen = [pair for pair in pairs if not extent or pair[2] == (extent == "quick")]
            assert chosen, "no case to run"
            for name, case, _ in chosen:
                try:
                    once(**case, **fixtures)
                except (Exception, pytest.fail.Exception, pytest.skip.Exception) as problem:
                    with subtests.test(
                        msg=name
                    ):  # of this case alone: to report one takes longer than many take to run
                        raise problem

        signature = inspect.signature(test)
        parts = quick is not None and "extent" not in signature.parameters
        kept = [p for name, p in signature.parameters.items() if name not in {*words, "subtests"}]
        first = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY) for name in ("subtests", *parts * ["extent"])]
        taken = [*first, *(p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in kept)]
        run.__name__, run.__doc__, run.__module__ = test.__name__, test.__doc__, test.__module__
        vars(run).update(vars(test))  # marks
        vars(run).update(__signature__=signature.replace(parameters=taken), looped=(once, pairs))
        if parts:
            rest = pytest.param("more", marks=pytest.mark.more)
            pytest.mark.parametrize("extent", ["quick", rest])(run)  # in place
        return run

    return decorate
