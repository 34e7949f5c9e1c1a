"""What every figure of a paper demands of the runs behind it."""


def require_none_escaped(scheme: str, escaped: int) -> None:
    """Raise FloatingPointError if ``escaped`` people were outside of the walkable area: no figure is made of such a run."""
    if escaped:
        raise FloatingPointError(
            f"{scheme}: {escaped} people were outside of the plan at some decision; the run is void"
        )
