"""The places of validation/unseen, which no training draws: each is whole, and people fit through its exits."""

import warnings

import pytest
from repository import ROOT

from crowd_env import make_scenario

PLACES = sorted((ROOT / "validation/unseen").glob("*.toml"))


@pytest.mark.parametrize("path", PLACES, ids=lambda path: path.stem)
def test_every_place_is_whole(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing is joined, moved or left out
        place = make_scenario(path)
    assert place.title and place.manner == "competitive"
    body = 2.0 * place.population.radius.high
    assert min(place.geometry.clear_widths(body).values()) > body
    walk, _ = place.longest_walk()
    assert walk < place.time_limit
