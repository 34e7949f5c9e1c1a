"""Pictures of buildings: a letter at both ends of each seam, names of sheets, and a film wide enough to read them."""

import numpy as np
import PIL.Image
import pytest
from storeys import with_stair

from crowd_env import Scenario, record
from crowd_env.rendering import write_film
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.palette import SEAM
from crowd_env.rendering.plan import label_seams, label_sheets

pytestmark = pytest.mark.more
HOUSE = with_stair()


def test_a_letter_is_at_the_same_true_place_on_both_sheets_and_off_their_floor():
    ends: dict[str, list] = {}
    for letter, middle, outward in label_seams(HOUSE.building):
        ends.setdefault(letter, []).append(HOUSE.on_sheets(middle))
        assert not HOUSE.contains(middle + 0.3 * outward) and HOUSE.contains(middle - 0.3 * outward)
    assert sorted(ends) == ["A", "B"]
    for (one, left), (other, right) in ends.values():
        np.testing.assert_allclose(one, other)
        assert left != right


def test_seams_letters_and_names_are_drawn_where_they_belong():
    renderer = Renderer(HOUSE, width=960)
    picture, layout = np.asarray(renderer.draw(np.zeros((0, 2)), np.zeros(0))), renderer.layout

    def darkest(at, reach):
        x, y = np.rint(at).astype(int)
        return int(picture[y - reach : y + reach, x - reach : x + reach].min())

    for _, middle, outward in label_seams(HOUSE.building):
        column, row = np.rint(layout.pixels(middle + 0.04 * outward)).astype(int)
        assert np.abs(picture[row - 6 : row + 6, column - 6 : column + 6] - np.array(SEAM)).sum(axis=2).min() < 12
        assert darkest(layout.pixels(middle) + (layout.wall + 0.455 * layout.text) * outward * (1, -1), 5) < 90
    for name, corner, room in label_sheets(HOUSE.building):
        assert name.split("  ")[0] in ("ground", "upper", "stair") and room > 5.0
        assert darkest(np.add(layout.pixels(corner), (8, layout.wall + 0.455 * layout.text)), 6) < 160


def test_a_film_of_a_building_is_twice_as_wide(tmp_path):
    run = record(Scenario("house", HOUSE, [{"people": 2}], 20.0))
    assert PIL.Image.open(write_film(tmp_path / "house.png", run)).width == 960
    assert PIL.Image.open(write_film(tmp_path / "room.png", record("room-v0", people=2))).width == 480
