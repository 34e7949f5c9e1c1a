"""Recordings, films and figures."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from drawn_rooms import recording
from late import late
from recordings import two_doors

from crowd_env.physics.pressure import INJURY
from crowd_env.recording import record
from crowd_env.rendering import (
    egress_curves,
    learning_curve,
    save_figure,
    write_film,
    write_still,
    write_strip,
)
from crowd_env.rendering.curves import EgressStrip
from crowd_env.rendering.encoding import write_gif
from crowd_env.rendering.palette import BACKGROUND, EXIT_MAT, FLOOR, WALL, cohort_color

matplotlib = late("matplotlib")

PIL_Image = pytest.importorskip("PIL.Image")
imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")

# ---------------------------------------------------------------------------------------------------------- recordings


def test_between_frames_people_are_between_their_places():
    film = recording(finish=False)
    every = film.position.reshape(41, 20, 2)
    np.testing.assert_allclose(film.at(1.25).position, 0.5 * (every[12] + every[13]))
    np.testing.assert_array_equal(film.at(-1.0).position, every[0])
    np.testing.assert_array_equal(film.at(99.0).position, every[-1])


def test_pressure_shown_is_the_mean_over_a_while():
    film = recording(people=3, finish=False)
    pressure = film.pressure.reshape(41, 3)
    np.testing.assert_allclose(film.at(2.05, average=0.3).pressure, pressure[20:23].mean(axis=0))
    np.testing.assert_allclose(film.at(4.0, average=0.2).pressure, pressure[-1])
    assert not film.at(0.0).pressure.any()


def test_people_leave_at_their_exit_time():
    film = replace(recording(people=4, finish=False), exit_time=np.array([1.23, 2.0, 3.0, 3.96]))
    assert film.at(1.22).person.tolist() == [0, 1, 2, 3] and film.at(1.24).person.tolist() == [1, 2, 3]
    assert film.end == 3.96
    assert [int(film.inside(t)) for t in (0.0, 1.3, 3.5, 4.0)] == [4, 3, 1, 0]
    assert recording(finish=False).end == 4.0


def test_a_real_recording_shows_at_its_frames_who_is_inside_where():
    kept = record(two_doors(time_limit=4.0), scheme="dem", seed=1, every=0.5)
    for frame, time in enumerate(kept.times[kept.times <= kept.end]):
        seen, rows = kept.at(float(time)), np.flatnonzero((kept.frame == frame) & ~kept.beyond)
        np.testing.assert_array_equal(seen.person, kept.person[rows])
        np.testing.assert_allclose(seen.position, kept.position[rows], atol=1e-9)
    assert 0 < len(kept.at(99.0).person) == kept.facts["unfinished"]


# --------------------------------------------------------------------------------------------------------------- films


@pytest.mark.more
def test_gif_lasts_as_long_as_the_evacuation_and_is_small(tmp_path):
    drawn = []
    options = {"fps": 20.0, "progress": lambda count, of: drawn.append((count, of))}
    path = write_film(tmp_path / "room.gif", recording(end=4.0), **options)
    assert drawn == [(1, 80)] * 80
    assert path.stat().st_size < 1_500_000
    with PIL_Image.open(path) as film:
        assert film.n_frames <= 80 + 31
        shown = 0
        for k in range(film.n_frames):
            film.seek(k)
            shown += film.info["duration"]
        assert shown == pytest.approx(1000 * (4.0 + 1.5 + 0.05))
        assert film.size[0] == 480
    assert [file.name for file in tmp_path.iterdir()] == ["room.gif"]  # no temporary file is left


@pytest.mark.more
def test_a_long_evacuation_runs_faster_and_the_picture_says_so(tmp_path):
    film = recording(end=4.0, finish=False, times=np.linspace(0.0, 100.0, 41))
    drawn = []
    write_film(tmp_path / "a.gif", film, width=200, progress=lambda count, of: drawn.append(of))
    assert drawn == [313] * 313  # 25 s at 4 times the speed, a frame in 0.08 s
    options = {"width": 400, "margin": 10, "text": 14.0, "end": 100.0}
    real, fast = (np.asarray(EgressStrip([film], [""], speed=speed, **options).draw(0.0)) for speed in (1.0, 4.0))
    words = (real != fast).any(axis=-1)
    assert words.any() and not words[30:].any()  # in the line above the axes


@pytest.mark.more
def test_gif_keeps_flat_colors(tmp_path):
    film = recording(end=1.0, people=5)
    with PIL_Image.open(write_film(tmp_path / "a.gif", film, fps=5.0, width=320)) as gif:
        image = np.asarray(gif.convert("RGB")).astype(int)
    for color in (BACKGROUND, FLOOR, WALL, EXIT_MAT):
        assert (image == color).all(axis=-1).any(), color


@pytest.mark.more
def test_gif_shows_every_color_nearly_as_it_is(tmp_path):
    film = recording(end=2.0, people=30)
    still = np.asarray(PIL_Image.open(write_still(tmp_path / "a.png", film, 1.5, width=400))).astype(int)
    with PIL_Image.open(write_film(tmp_path / "a.gif", film, fps=2.0, width=400)) as gif:
        gif.seek(3)
        shown = np.asarray(gif.convert("RGB")).astype(int)
    apart = np.abs(shown - still).max(axis=-1)
    assert apart.mean() < 1.0 and np.quantile(apart, 0.999) <= 20  # letters and edges have fewer colors


@pytest.mark.more
def test_mp4_shows_the_evacuations_side_by_side_until_the_last_is_over(tmp_path):
    films = [recording(end=2.0), recording(end=3.0)]
    path = write_film(tmp_path / "two.mp4", films, fps=10.0, width=431)
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    assert about["fps"] == 10.0
    assert about["size"][0] == 428
    assert len(list(reader)) == 30 + 1 + 15


@pytest.mark.more
def test_an_evacuation_that_is_over_holds_its_last_frame(tmp_path):
    films = [recording(end=1.0), recording(end=3.0)]
    left = [
        np.asarray(PIL_Image.open(write_still(tmp_path / f"{t}.png", films, t, width=640)))[40:300, :320]
        for t in (1.5, 2.5)
    ]
    np.testing.assert_array_equal(left[0], left[1])


def test_a_still_shows_the_moment_of_most_pressure(tmp_path):
    pressure = np.zeros((41, 20))
    pressure[18:23] = INJURY
    assert recording(pressure=pressure).peak_time() == pytest.approx(2.0, abs=0.11)
    assert 0.0 < recording(pressure=0 * pressure).peak_time() < 4.0


@pytest.mark.more
def test_a_strip_shows_several_moments(tmp_path):
    path = write_strip(tmp_path / "new" / "strip.png", recording(), [0.0, 1.0, 3.0], width=900)
    assert PIL_Image.open(path).size[0] == 900
    with pytest.raises(ValueError, match="at least one time"):
        write_strip(tmp_path / "strip.png", recording(), [])


@pytest.mark.more
@looped("name", ["film.avi", "film"])
def test_unknown_suffixes_are_refused_and_the_known_are_named(tmp_path, name):
    with pytest.raises(ValueError, match=r"\.gif, \.mp4, \.png"):
        write_film(tmp_path / name, recording())
    with pytest.raises(ValueError, match=r"must end in \.png"):
        write_still(tmp_path / name, recording())
    with pytest.raises(ValueError, match=r"must end in \.png"):
        save_figure(egress_curves({"a": [[1.0]]}), tmp_path / name)


@pytest.mark.more
def test_a_film_that_fails_leaves_the_old_one(tmp_path):
    path = tmp_path / "film.gif"
    path.write_text("the old one")

    def broken():
        yield PIL_Image.new("RGB", (20, 20))
        raise RuntimeError("no more frames")

    with pytest.raises(RuntimeError, match="no more"):
        write_gif(path, broken(), 0.1, [PIL_Image.new("RGB", (20, 20))])
    assert path.read_text() == "the old one"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.more
def test_films_need_recordings_and_a_rate(tmp_path):
    with pytest.raises(ValueError, match="at least one recording"):
        write_film(tmp_path / "a.gif", [])
    with pytest.raises(ValueError, match="fps"):
        write_film(tmp_path / "a.gif", recording(), fps=0.0)
    with pytest.raises(ValueError, match="speed"):
        write_film(tmp_path / "a.gif", recording(), speed=-1.0)


@pytest.mark.more
def test_cohorts_have_rims_and_names_in_their_colors(tmp_path):
    film = recording(people=12)
    cohorts = recording(people=12, cohorts=("quick", "slow"))
    path = write_still(tmp_path / "cohorts.png", cohorts, 0.5)
    image, plain = (
        np.asarray(PIL_Image.open(one)).astype(int) for one in (path, write_still(tmp_path / "a.png", film, 0.5))
    )
    for color in cohort_color([0, 1]).astype(int):
        near, before = (np.abs(one - color).sum(axis=-1) < 12 for one in (image, plain))
        assert near.sum() > before.sum() + 30


# ------------------------------------------------------------------------------------------------------------- figures


@pytest.mark.more
def test_figures_are_written_and_touch_no_global_setting(tmp_path):
    before = dict(matplotlib.rcParams)
    rng = np.random.default_rng(0)
    runs = [np.sort(rng.uniform(1.0, 8.0, 20)) for _ in range(4)]
    unfinished = runs[0].copy()
    unfinished[-2:] = np.nan
    nobody = np.full(20, np.nan)
    steps = np.arange(10)
    made = [
        egress_curves({"rule": runs, "learned": [unfinished]}, title="Room"),
        egress_curves({"stuck": [nobody]}),
        egress_curves({"recorded": [unfinished], "simulated": runs}, title="Bottleneck"),
        learning_curve(steps, {"one": steps, "three": rng.random((3, 10))}, reference={"rule": 4.0}),
        learning_curve(steps, {"one": steps}, errors={"one": np.full(10, 0.5)}),
        learning_curve(steps, {"one": steps}),
    ]
    paths = [save_figure(figure, tmp_path / f"{k}.png") for k, figure in enumerate(made)]
    assert paths[-2].read_bytes() != paths[-1].read_bytes()  # the band is drawn
    for path in paths:
        with PIL_Image.open(path) as image:
            assert image.size == (960, 600)
    assert len(list(tmp_path.iterdir())) == len(paths)
    assert dict(matplotlib.rcParams) == before
    if "matplotlib.pyplot" in sys.modules:
        assert not sys.modules["matplotlib.pyplot"].get_fignums()


@pytest.mark.more
def test_figures_of_nothing_are_refused():
    with pytest.raises(ValueError, match="'rule' has no evacuation"):
        egress_curves({"rule": []})
    with pytest.raises(ValueError, match="at least one label"):
        egress_curves({})
    with pytest.raises(ValueError, match="must have 3 values"):
        learning_curve([1, 2, 3], {"a": [1.0, 2.0]})
    for errors in ({"a": [1.0, 2.0]}, {"b": [1.0, 2.0, 3.0]}):
        with pytest.raises(ValueError, match=r"errors of '.' have shape .* must be \(3,\) of a series"):
            learning_curve([1, 2, 3], {"a": [1.0, 2.0, 3.0]}, errors=errors)
    with pytest.raises(ValueError, match="at least one series"):
        learning_curve([1, 2, 3], {})
