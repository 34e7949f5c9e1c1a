"""All levels of a file together: stairs that it draws become stairs of a building, and what does not fit is named."""

import tomllib

import numpy as np
import pytest
import shapely
from cases import looped
from commands import call
from evacuations import evacuated
from plan_files import feature, geojson

from crowd_env import make_scenario
from crowd_env.scenarios.file import read_scenario
from crowd_env.scenarios.storeys import building_in

LINE, POINT, BOX = shapely.LineString, shapely.Point, shapely.box


def floors(stairs, levels="0;1", doors=(), upper=None, way_in=True):
    """Return a corridor on two levels, and stairs and doors on ``levels``; the way in is on level 0."""
    return [
        feature(BOX(0, 0, 20, 4), indoor="corridor", level=0),
        feature(upper or BOX(0, 0, 20, 4), indoor="corridor", level=1),
        *([feature(POINT(0, 2), entrance="main", width="2 m", level=0)] if way_in else []),
        *(feature(shape, **{"level": levels, **words}) for shape, words in stairs),
        *(feature(POINT(*point), door="hinged", level=levels) for point in doors),
    ]


ROOM = {"indoor": "room", "room": "stairs"}
# Name -> features, and form, width [m] and direction [degrees] of the stair that they become.
DRAWN = {
    "a room with a door": (floors([(BOX(8, 4, 11, 10), ROOM)], doors=[(9.5, 4)]), "u", 1.45, 90),
    "a room with a door, turned": (floors([(BOX(-6, 0.5, 0, 3.5), ROOM)], doors=[(0, 2)], way_in=False), "u", 1.45, 180),
    "a room without doors": (floors([(BOX(8, 4, 11, 8), ROOM)]), "u", 1.45, 90),
    "steps from hall to hall": (
        floors([(BOX(8, 4, 10, 10), {"highway": "steps"})], upper=shapely.union(BOX(0, 0, 4, 12), BOX(0, 10, 20, 12))),
        *("straight", 2.0, 90),
    ),
    "a line": (floors([(LINE([(20, 2), (25.6, 2)]), {"highway": "steps"})], upper=BOX(25.6, 0, 40, 4)), "straight", 1.5, 0),
    "a line down": (
        floors([(LINE([(25.6, 2), (20.2, 2)]), {"kind": "steps", "incline": "down", "width": 1.2})], upper=BOX(25.7, 0, 40, 4)),
        *("straight", 1.2, 0),
    ),
    "an escalator": (floors([(BOX(20, 1, 26, 2), {"kind": "escalator"})], upper=BOX(26, 0, 40, 4)), "straight", 1.0, 0),
    "a ramp": (floors([(BOX(20, 1, 36, 3), {"kind": "ramp"})], upper=BOX(36, 0, 40, 4)), "ramp", 2.0, 0),
}  # fmt: skip


@looped("name", DRAWN)
def test_what_is_drawn_becomes_a_stair(name, tmp_path):
    features, form, width, direction = DRAWN[name]
    extra = [] if any("entrance" in str(one) for one in features) else [feature(POINT(20, 2), exit="yes", level=0)]
    path = geojson(tmp_path / "house.geojson", *features, *extra)
    content = building_in(path).content
    (way,) = content.get("stairs", content.get("ramps"))
    assert (way["lower"], way["upper"]) == ("0", "1")
    found = "ramp" if "ramps" in content else way.get("turns", "straight")[:8]
    assert found.startswith(form)
    assert way.get("width", 2.0 if form == "ramp" else 1.2) == pytest.approx(width) and way["direction"] == direction
    place = make_scenario(path, people=8)
    assert [sheet.name for sheet in place.geometry.building.sheets][:2] == ["0", "1"]
    upper = place.population.changed(start_region="1")
    env = evacuated(make_scenario(path, population=upper))
    assert not env.simulation.state.active.any()


def offices(tmp_path):
    """Write three levels with rooms and a stair in a room of its own, in degrees, as OpenStreetMap has them."""
    rooms = [
        [feature(BOX(6 * k, 0, 6 * k + 6, 5), indoor="room", name=f"office {k}", level="0-2") for k in range(3)],
        [feature(POINT(6 * k + 3, 5), door="hinged", level="0-2") for k in range(3)],
        [feature(BOX(0, 5, 18, 8), indoor="corridor", level="0", repeat_on="1-2")],
        [
            feature(BOX(2, 8, 5, 14), name="north", **ROOM, level="0;1;2"),
            feature(POINT(3.5, 8), door="yes", level="0-2"),
        ],
        [feature(POINT(18, 6), entrance="main", level="0")],
    ]
    on_ground = [one for group in rooms for one in group]
    return geojson(tmp_path / "house.geojson", *on_ground)


def test_a_house_of_openstreetmap_and_its_project_are_one_place(tmp_path, monkeypatch):
    path = offices(tmp_path)
    with pytest.warns(UserWarning, match="heights of levels are not drawn: taken as 3.5 m apart"):
        whole = make_scenario(path, people=30)
    assert whole.geometry.building.sheets[1].level == 3.5 and len(whole.geometry.building.sheets) == 5
    assert whole.title == "floor plan house.geojson, all levels"
    monkeypatch.chdir(tmp_path)
    said = call("plan house.geojson --save h.toml")
    assert "3 levels and 2 stairs" in said.output
    saved = read_scenario(tmp_path / "h.toml")
    assert np.array_equal(saved.geometry.walls, whole.geometry.walls)
    assert saved.geometry.walkable.equals(whole.geometry.walkable)
    kept = tomllib.loads((tmp_path / "h.toml").read_text())
    assert [level["height"] for level in kept["levels"]] == [0.0, 3.5, 7.0]
    assert all(level["file"] == "house.geojson" for level in kept["levels"])
    assert "stairs are" not in "".join(said.output.splitlines())  # they are no floor like any other
    assert make_scenario(f"{path}:1", exits=["18,6,18,7"]).geometry.building is None


def test_names_that_levels_share_and_what_no_stair_joins(tmp_path):
    features = [
        *floors([(BOX(8, 4, 11, 8), ROOM)]),
        feature(BOX(1, 1, 2, 2), kind="start", name="desk", level="0"),
        feature(BOX(1, 1, 2, 2), kind="start", name="desk", level="1"),
        feature(BOX(0, 0, 5, 5), indoor="area", level="5"),
        feature(BOX(12, 4, 14, 6), kind="stairs", level="1"),
        feature(BOX(15, 4, 16, 5), kind="stairs", level="0;1"),
    ]
    path = geojson(tmp_path / "house.geojson", *features)
    project = building_in(path)
    notes = "\n".join(project.head)
    assert "left out: 1 level that no stair joins to an exit, 5; house.geojson:5 is one alone" in notes
    assert "left out: 1 stair on one level alone" in notes
    assert "left out: stair from 0 to 1, 2, 1.0 x 1.0 m at (15.5, 4.5): none of its forms climbs 3.5 m" in notes
    assert [one["start_region"] for one in project.content["cohorts"]] == ["desk of 0", "desk of 1"]
    assert {"desk of 0", "desk of 1"} <= set(make_scenario(path).geometry.regions)


def test_levels_without_stairs_and_options_of_one_level_are_refused(tmp_path):
    path = geojson(tmp_path / "house.geojson", *floors([]))
    with pytest.raises(ValueError, match=r"it has 2 levels \(0, 1\), and people walk on one; choose one"):
        make_scenario(path)
    path = geojson(tmp_path / "house.geojson", *floors([(BOX(8, 4, 11, 8), ROOM)], way_in=False))
    place = make_scenario(path, exits=["0,1,0,3"])  # on level 0
    assert place.exits == ("exit-0",)
    with pytest.raises(ValueError, match="doors belong to one level"):
        make_scenario(path, exits=["0,1,0,3"], doors={"d": [[5, 0], [5, 4]]})
    with pytest.raises(ValueError, match=r"at least one exit: --exit .* on level 0, which crowd-env plan house"):
        make_scenario(path)


def test_a_building_of_imdf_has_ground_where_its_ordinal_is_0(tmp_path):
    def imdf(kind, shape, key=None, **words):
        return {**feature(shape, **words), "feature_type": kind, "id": key}

    features = []
    for key, name, ordinal in (("a", "Basement", -1), ("b", "Ground", 0), ("c", "Roof", 1)):
        units = {"walkway": BOX(0, 0, 20, 4), "stairs": BOX(8, 4, 11, 8), "elevator": BOX(15, 4, 17, 6)}
        features += [imdf("level", BOX(0, 0, 20, 8), key, name={"en": name}, ordinal=ordinal)]
        features += [imdf("unit", shape, category=word, level_id=key) for word, shape in units.items()]
    place = make_scenario(geojson(tmp_path / "mall.geojson", *features), exits=["0,1,0,3"], people=9)
    sheets = place.geometry.building.sheets
    assert [(one.name, one.level) for one in sheets[:3]] == [("Basement", -3.5), ("Ground", 0.0), ("Roof", 3.5)]
    assert len(sheets) == 5 and place.geometry.exits.mean(axis=(0, 1))[1] - sheets[1].offset[1] == pytest.approx(2.0)
    assert not evacuated(place).simulation.state.active.any()
