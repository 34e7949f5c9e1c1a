"""The page of phenomena: a film of each, and cells that follow from the tables as these lie there."""

import numpy as np
import pytest

from examples import phenomena
from validation.pages import read_table


def test_every_phenomenon_has_a_film_and_rows():
    assert set(phenomena.FILMS) == {row[0] for row in read_table("phenomena")[1:]} == {*phenomena.KNOWN, *phenomena.NEW}


@pytest.mark.parametrize("name", phenomena.KNOWN)
def test_cells_that_other_tables_hold_are_those_of_the_tables(name):
    head, *rows = read_table("phenomena")
    schemes = [scheme.strip("`") for scheme in head[2:]]
    stored = {row[1]: dict(zip(schemes, row[2:], strict=True)) for row in rows if row[0] == name}
    now = {manner: phenomena.KNOWN[name](manner) for manner in phenomena.MANNERS}
    assert stored == {manner: {s: cells.get(s, "") for s in schemes} for manner, cells in now.items() if cells}, (
        "run python -m examples.phenomena measure"
    )


def test_an_interval_holds_no_negative_zero():
    low, high, said = phenomena.interval([-0.01, 0.01, 0.0], 0)
    assert (low, high, said) == (0.0, 0.0, "0 (0 to 0)") and not np.signbit([low, high]).any()
