"""The places of places.toml, of cases and of the tests of standards."""

from pathlib import Path

from shapely.geometry import Polygon, box

from crowd_env import Geometry
from validation.pages import read_toml

PLACES = read_toml(Path(__file__).with_name("places.toml"))


def place(name: str) -> Geometry:
    """Return the place of a name in places.toml."""
    facts = dict(PLACES[name])
    floor = [Polygon(each) if isinstance(each[0], list) else box(*each) for each in facts.pop("floor")]
    regions = {region: box(*each) for region, each in facts.pop("regions", {}).items()}
    return Geometry.from_polygon(floor, regions=regions, **facts)
