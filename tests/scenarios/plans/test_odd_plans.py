"""Plans of the kinds that others draw: each makes a scenario in which somebody gets out, and a note says what was mended."""

import warnings

import numpy as np
import pytest
import shapely
from cases import looped
from plan_files import EAST, ODD, ROOM, far

from crowd_env import make_scenario
from crowd_env.envs.rollout import run_episodes
from crowd_env.scenarios.plans.reading import read_plan

pytestmark = pytest.mark.more


def written(tmp_path, text, name="plan.wkt"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


@looped("name", ODD)
def test_it_is_understood_and_people_get_out(name, tmp_path):
    odd = ODD[name]
    path = written(tmp_path, odd.text)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        place = make_scenario(path, exits=[odd.exit] if odd.exit else [], people=3, time_limit=60.0)
    assert place.geometry.area == pytest.approx(odd.area, abs=0.02 if odd.area < 100 else 0.1)
    notes = " / ".join(str(one.message) for one in said)
    assert bool(notes) == bool(odd.note), notes
    for word in odd.note.split():
        assert word in notes
    (episode,) = run_episodes(place, 1, scheme="dem", seed=0)
    assert np.isfinite(episode.exit_time).all()


def test_coordinates_far_away_lose_nothing(tmp_path):
    near = make_scenario(written(tmp_path, ROOM.wkt, "near.wkt"), exits=[EAST])
    away = make_scenario(written(tmp_path, far(ROOM).wkt, "far.wkt"), exits=["5652115,4471225,5652115,4471226.2"])
    assert away.geometry.area == pytest.approx(near.geometry.area, abs=1e-6)
    width = [shapely.length(shapely.linestrings(place.geometry.exits)).sum() for place in (near, away)]
    assert width[1] == pytest.approx(width[0], abs=1e-6)


def test_simplifying_moves_no_wall_by_more_than_is_said(tmp_path):
    fine = shapely.from_wkt(ODD["40000 corners"].text)
    plan = read_plan(written(tmp_path, fine.wkt))
    assert shapely.get_num_coordinates(plan.walkable) < 1000
    assert shapely.hausdorff_distance(plan.walkable, fine) <= 0.005 + 1e-9
    assert any("simplified" in note for note in plan.notes)


def test_given_exits_take_the_place_of_those_in_the_file(tmp_path):
    path = written(tmp_path, ODD["JuPedSim's converter"].text)
    assert list(read_plan(path).exits) == ["exit-0"]
    plan = read_plan(path, [EAST, "0,1,0,2"])
    assert [shape.geom_type for shape in plan.exits.values()] == ["LineString", "LineString"]
    assert any("left out for those that are given" in note for note in plan.notes)


def test_people_start_in_the_start_areas_of_the_file(tmp_path):
    path = written(tmp_path, ODD["JuPedSim's converter"].text)
    with pytest.warns(UserWarning, match="1 area to start in"):
        place = make_scenario(path, people=8)
    (part,) = place.population.parts
    assert (part.people, part.start_region) == (8, "start-0")


@looped(
    "text",
    [
        f"# a hall\n{ROOM.wkt}\n# and a passage\n{shapely.box(8, 2, 10, 4).wkt}\n",
        f"SRID=25832;{ROOM.wkt}\n\nPOLYGON\n((8 2, 10 2,\n 10 4, 8 4, 8 2))",
        f"GEOMETRYCOLLECTION (\nPOLYGON ((8 2, 10 2, 10 4, 8 4, 8 2)),\n{ROOM.wkt})",
    ],
)
def test_comments_and_one_geometry_a_line_are_read(text, tmp_path):
    plan = read_plan(written(tmp_path, text))
    assert plan.walkable.area == pytest.approx(52.0) and plan.notes == ()


def test_of_several_geometries_the_wrong_one_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"plan.wkt: geometry 1 of the walkable area is not well-known text"):
        read_plan(written(tmp_path, f"{ROOM.wkt}\nPOLYGN ((0 0))\n"))


@looped(
    ("lines", "area", "notes"),
    [
        (["0 0, 8 0, 8 6, 0 6, 0 0"], 48.0, ["1 line taken as outlines of the floor"]),
        (["0 0, 8 0, 8 6", "8.004 6, 0 6, 0 0"], 48.0, ["2 lines taken as outlines of the floor"]),
        (
            ["0 0, 8 0, 8 6, 0 6, 0 0", "2 1, 2 4"], 48.0,
            ["2 lines taken as outlines of the floor", "left out: 1 line that encloses nothing; of the longest its ends (2, 1"],
        ),
    ],
)  # fmt: skip
def test_lines_alone_are_outlines(lines, area, notes, tmp_path):
    for text in (
        "\n".join(f"LINESTRING ({line})" for line in lines),
        f"MULTILINESTRING ({', '.join(f'({one})' for one in lines)})",
    ):
        plan = read_plan(written(tmp_path, text))
        assert plan.walkable.area == pytest.approx(area, abs=0.02)
        assert all(note.startswith(words) for note, words in zip(plan.notes, notes, strict=True))
    meters = read_plan(written(tmp_path, text), unit="cm")
    assert meters.walkable.area == pytest.approx(area * 1e-4, abs=2e-6)


def test_lines_that_enclose_nothing_are_refused(tmp_path):
    with pytest.raises(
        ValueError, match=r"its LineStrings enclose no area, its ends \(0, 0\) and \(8, 6\) are 10 m apart"
    ):
        read_plan(written(tmp_path, "LINESTRING (0 0, 8 0, 8 6)"))


def test_a_hole_that_shares_an_edge_with_the_outline_is_cut(tmp_path):
    """It was refused, and of holes that share an edge the note said another place."""
    plan = read_plan(written(tmp_path, "POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0), (3 0, 5 0, 5 2, 3 2, 3 0))"))
    assert plan.walkable.equals(ROOM.difference(shapely.box(3, 0, 5, 2)))
    assert plan.notes == ("walkable area: mended 1 outline that runs along itself, such as at (3, 0)",)
    two = "(2 2, 3 2, 3 3, 2 3, 2 2), (3 2, 4 2, 4 3, 3 3, 3 2)"
    plan = read_plan(written(tmp_path, f"POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0), {two})"))
    assert plan.walkable.area == pytest.approx(46.0) and plan.notes[0].endswith(("at (3, 2)", "at (3, 3)"))
    with pytest.raises(ValueError, match="its rings may not cross"):
        read_plan(written(tmp_path, "POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0), (3 -1, 5 -1, 5 2, 3 2, 3 -1))"))
