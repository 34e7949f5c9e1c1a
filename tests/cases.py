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

    def named(k: int, case: Any) -> str:
        if callable(ids):
            return str(ids(case))
        return str(ids[k]) if ids else ", ".join(f"{word}={value!r}" for word, value in of(case).items())

    def of(case: Any) -> dict[str, Any]:
        return dict(zip(words, case if len(words) > 1 else (case,), strict=True))

    def decorate(test: Callable[..., Any]) -> Callable[..., Any]:
        def run(subtests: Any, **fixtures: Any) -> None:
            assert cases, "no case to run"
            own = {"subtests": subtests} if takes_subtests else {}
            for k, case in enumerate(cases):
                with subtests.test(msg=named(k, case)):
                    test(**own, **of(case), **fixtures)

        signature = inspect.signature(test)
        takes_subtests = "subtests" in signature.parameters  # of a loop within this one
        kept = [p for name, p in signature.parameters.items() if name not in {*words, "subtests"}]
        first = inspect.Parameter("subtests", inspect.Parameter.KEYWORD_ONLY)
        kept = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in kept]
        run.__dict__.update(test.__dict__)  # marks
        run.__signature__ = signature.replace(parameters=[first, *kept])  # type: ignore[attr-defined]
        run.__name__, run.__doc__, run.__module__ = test.__name__, test.__doc__, test.__module__
        return run

    return decorate
