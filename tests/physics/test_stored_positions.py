"""Positions after a few steps of every scheme, beside stored ones: a change of the physics is seen on any machine.

To 1e-9 m: bits differ between processors, and this early nothing has amplified them (a shift of the starts by 1e-13 m grows
to about 1e-12 m).  Where a change is meant, `python -m validation bits --write-positions` stores them anew.
"""

import json

import numpy as np
import pytest

from crowd_env import SCHEMES
from validation import positions
from validation.positions import STORED

KNOWN = json.loads(STORED.read_text(encoding="utf-8"))


def test_every_scheme_has_stored_positions():
    assert set(KNOWN) == set(SCHEMES)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_people_stand_where_they_stood(scheme):
    np.testing.assert_allclose(positions.walked(scheme), KNOWN[scheme], rtol=0.0, atol=1e-9)


def test_the_schemes_have_parted_by_then():
    """In contact: before the first touch the schemes with inertia would all give the same."""
    last = {name: np.array(steps)[-1] for name, steps in KNOWN.items()}
    for name in ("dem", "nsm1-inertial", "nsm2", "hertz"):
        others = [np.abs(last[name] - last[other]).max() for other in last if other != name]
        assert min(others) > 1e-3


def test_what_is_written_is_read_back_to_the_bit(tmp_path, monkeypatch):
    monkeypatch.setattr(positions, "SCHEMES", {"dem": None})
    positions.write(tmp_path / "data" / "positions.json")
    found = json.loads((tmp_path / "data" / "positions.json").read_text(encoding="utf-8"))
    assert found == {"dem": positions.walked("dem")}
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["positions.json"]
