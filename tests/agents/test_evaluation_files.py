"""The folder of an evaluation: what is kept, when it is made anew, and who can be evaluated from a file."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluations import RULED, SMALL, call, hall, random_network, random_policy, run

import crowd_env
from crowd_env import SCHEMES, Cohorts, DoorEvent, Normal, SpeedZone, Uniform, make_scenario
from crowd_env.agents.evaluation import evaluation
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of, source_stamp
from crowd_env.agents.trained import LearnedController
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.geometry.geometry import box
from crowd_env.physics import SocialForce


def everything(folder):
    """Return what lies in a folder but times of computing."""
    told = json.loads((folder / "rows.json").read_text())
    for row in told["rows"]:
        for name in [name for name in row if "second" in name]:
            del row[name]
    return told, (folder / "runs.csv").read_text()


ASKED = ("--scenario", "hall", "--policies", "shortest", "east", "--scheme", "nsm2", "dem", "--runs", 2)


@pytest.mark.more
def test_the_folder_holds_rows_runs_curves_and_maps(small, tmp_path):
    code, _, _ = call(*ASKED, "--out", tmp_path / "out")
    assert code == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    maps = {f"heat-{policy}-{scheme}.png" for policy in ("shortest", "east") for scheme in ("nsm2", "dem")}
    assert names == {"rows.json", "runs.csv", "evaluation.json", "kept", "egress-nsm2.png", "egress-dem.png"} | maps
    with (tmp_path / "out/runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8 and rows[0]["seed"] == str(HELD_OUT_SEED)
    result = run("shortest", runs=2)
    assert float(rows[1]["evacuation_time"]) == pytest.approx(result.episodes[1].evacuation_time, rel=1e-5)
    assert float(rows[1]["walked"]) == pytest.approx(result.measured.walked[1].mean(), rel=1e-5)
    assert {rows[2]["out by east"], rows[2]["out by west"]} == {"14", "0"}


@pytest.mark.more
def test_an_interrupted_evaluation_goes_on_and_ends_as_if_it_had_not_been(small, tmp_path, monkeypatch):
    monkeypatch.setattr(EvaluationFolder, "draw", lambda *a: [])  # pictures are another matter
    assert call(*ASKED, "--out", tmp_path / "whole")[0] == 0
    real, batches = evaluation.simulate_batch, []

    def breaks_at_the_third(*work):
        if len(batches) == 2:
            raise KeyboardInterrupt
        batches.append(work)
        return real(*work)

    monkeypatch.setattr(evaluation, "simulate_batch", breaks_at_the_third)
    code, _, err = call(*ASKED, "--out", tmp_path / "broken")
    assert code == 130 and "goes on" in err and not (tmp_path / "broken/rows.json").exists()
    kept = {path.name for path in (tmp_path / "broken/kept").iterdir()}
    assert kept == {"shortest-nsm2.npz", "east-nsm2.npz"}
    again = []
    monkeypatch.setattr(evaluation, "simulate_batch", lambda *work: again.append(work) or real(*work))
    assert call(*ASKED, "--out", tmp_path / "broken")[0] == 0
    assert len(again) == 2
    assert everything(tmp_path / "broken") == everything(tmp_path / "whole")


def test_a_kept_result_is_the_result(tmp_path):
    (entry,) = make_entries(["fastest"], SMALL)
    result, folder = run("fastest"), EvaluationFolder(tmp_path, settings_of(SMALL, 3, 0))
    assert folder.load_result(entry, "nsm2") is None
    folder.keep_result(entry, "nsm2", result)
    read = folder.load_result(entry, "nsm2")
    assert read.row() == result.row() and repr(read.episodes) == repr(result.episodes)
    np.testing.assert_array_equal(read.measured.maps.density_mean, result.measured.maps.density_mean)
    np.testing.assert_array_equal(read.exit_times, result.exit_times)
    assert read.measured.grid == result.measured.grid and read.exit_names == result.exit_names
    assert folder.load_result(entry, "dem") is None
    for path in (tmp_path / "kept").iterdir():
        path.write_bytes(path.read_bytes()[:100])
    assert folder.load_result(entry, "nsm2") is None


def test_a_folder_does_not_mix_what_cannot_be_compared(kept):
    folder, _, _ = kept
    here = folder.identity
    assert EvaluationFolder(folder.folder, settings_of(hall(count=3), 1, 0)).identity == here
    others = {
        "runs": settings_of(hall(count=3), 4, 0),
        "seed": settings_of(hall(count=3), 1, 1),
        "digest": settings_of(hall(count=13), 1, 0),
    }
    for what, settings in others.items():
        with pytest.raises(ValueError, match=f"{what} is .* there and .* here; name another folder"):
            EvaluationFolder(folder.folder, settings)
    assert settings_of(RULED, 1, 0)["digest"] != settings_of(SMALL, 1, 0)["digest"]


def test_the_digest_is_of_everything_that_decides_a_result():
    people, place = SMALL.population, SMALL.geometry
    changed = [
        SMALL,
        *(
            replace(SMALL, population=people.changed(**one))
            for one in (
                {"route": "west"},
                {"exits": ("east",)},
                {"name": "x"},
                {"start_region": None},
                {"mass": Uniform(80.0, 80.0)},
                {"desired_speed": Normal(1.3, 0.2, 0.9, 2.0)},
                {"desired_speed": Normal(1.3, 0.1, 0.9, 2.0)},
                {"starts": np.ones((14, 2)), "start_region": None},
                {"response_time": Uniform(0.0, 9.0)},
            )
        ),
        replace(SMALL, population=Cohorts((people.changed(people=7, name="a"), people.changed(people=7, name="b")))),
        replace(SMALL, geometry=replace(place, exits=place.exits + 0.5)),
        replace(SMALL, geometry=replace(place, exit_names=("east", "west"))),
        replace(SMALL, geometry=replace(place, two_sided=~place.two_sided)),
        replace(SMALL, zones=(SpeedZone("left", factor=0.5),)),
        replace(SMALL, door_events=(DoorEvent("west", False, at=3.0),)),
        replace(SMALL, closed_doors=("west",)),
        replace(SMALL, time_limit=26.0),
        RULED,
    ]
    digests = [settings_of(scenario, 3, 0)["digest"] for scenario in changed]
    assert len(set(digests)) == len(digests)
    assert settings_of(hall(), 3, 0)["digest"] == digests[0]
    assert settings_of(replace(SMALL, title="another title"), 3, 0)["digest"] == digests[0]


def test_nothing_is_spelt_like_something_else():
    values = [1, 1.0, True, "1", b"1", None, (1,), [1], {1: 2}, {1: "2"}, {"1": 2}, ((1,), 2), ((1, 2),), {1, 2}]
    values += [
        np.ones(2),
        np.ones((2, 1)),
        np.ones(2, dtype=np.float32),
        np.zeros(2),
        Uniform(1.0, 2.0),
        box(0, 0, 1, 1),
    ]
    assert len({fingerprint(value) for value in values}) == len(values)
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1}) != fingerprint(["a", 1], ["b", 2])


@pytest.fixture
def kept(tmp_path):
    """Return folder, entry and result of one that is kept."""
    scenario = hall(count=3)
    (entry,) = make_entries(["shortest"], scenario)
    folder, result = EvaluationFolder(tmp_path, settings_of(scenario, 1, 0)), run("shortest", scenario, runs=1)
    folder.keep_result(entry, "nsm2", result)
    return folder, entry, result


def test_what_other_code_or_another_scheme_computed_is_computed_anew(kept, monkeypatch):
    folder, entry, _ = kept
    assert folder.load_result(entry, "nsm2") is not None
    with monkeypatch.context() as patch:
        patch.setattr("crowd_env.agents.evaluation.folder.source_stamp", lambda: "other")
        assert folder.load_result(entry, "nsm2") is None
    monkeypatch.setitem(SCHEMES, "nsm2", replace(SCHEMES["nsm2"], social=SocialForce()))
    assert folder.load_result(entry, "nsm2") is None


def test_the_stamp_of_the_code_is_of_all_its_sources(tmp_path, monkeypatch):
    before = source_stamp()
    copied = tmp_path / "crowd_env"
    shutil.copytree(
        Path(crowd_env.__file__).parent, copied, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
    )
    monkeypatch.setattr(crowd_env, "__file__", str(copied / "__init__.py"))
    assert source_stamp.__wrapped__() == before
    for name in ("physics/nsm2.py", "envs/reward.py", "envs/metrics.py"):
        (copied / name).write_text((copied / name).read_text() + "\n")
        now = source_stamp.__wrapped__()
        assert now != before
        before = now


def test_a_damaged_file_is_computed_anew(kept):
    folder, entry, result = kept
    (path,) = (folder.folder / "kept").iterdir()
    whole, rng, read = path.read_bytes(), np.random.default_rng(0), 0
    for bit in rng.integers(0, 8 * len(whole), 150):
        harmed = bytearray(whole)
        harmed[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(bytes(harmed))
        found = folder.load_result(entry, "nsm2")  # no error, whatever broke
        if found is not None:
            read += 1
            assert found.row() == result.row()
    assert read < 50
    for content in (b"", b"no zip", whole[:500]):
        path.write_bytes(content)
        assert folder.load_result(entry, "nsm2") is None


# -------------------------------------------------------------------------------------------------------------- learned


def test_a_learned_network_is_a_policy_named_after_its_file(tmp_path):
    path, other = tmp_path / "quick.safetensors", tmp_path / "more/quick.safetensors"
    other.parent.mkdir()
    random_policy(0).save(path)
    other.write_bytes(path.read_bytes())
    (entry,) = make_entries([str(path)], SMALL)
    assert entry.name == "quick"
    result = run(str(path), runs=2)
    assert result.policy == "quick" and result.row()["walked"]["mean"] > 0
    assert [one.name for one in make_entries([str(path), str(other)], SMALL)] == [str(path), str(other)]
    folder = EvaluationFolder(tmp_path / "out", settings_of(SMALL, 2, 0))
    folder.keep_result(entry, "nsm2", result)
    assert folder.load_result(entry, "nsm2") is not None
    random_policy(1).save(path)
    assert folder.load_result(entry, "nsm2") is None  # another network under the same name


def test_a_learned_controller_is_a_policy_for_the_place_it_was_trained_for(tmp_path):
    options = {"grid": (2, 1), "interval": 1.0}
    batch = RoutingBatch(SMALL, **options)
    network = random_network(batch.layout.size, int(batch.choices.sum()))
    path = tmp_path / "leader.safetensors"
    LearnedController(network, batch.choices, {**options, "threads": 2}, {"scenario": "hall"}).save(path)
    result = run(str(path), runs=2)
    loaded = LearnedController.load(path)
    assert loaded.options == {"grid": [2, 1], "interval": 1.0}
    theirs = evaluate(loaded, SMALL, runs=2)
    assert result.policy == "leader" and result.column("mean_exit_time") == pytest.approx(
        theirs.column("mean_exit_time")
    )
    with pytest.raises(ValueError, match=r"leader\.safetensors was trained for hall"):
        make_entries([str(path)], make_scenario("room-v0"))
    LearnedController(network, batch.choices, {"scenario": "hall", "grid": "wide"}).save(path)
    with pytest.raises(ValueError, match=r"leader\.safetensors does not fit hall"):
        make_entries([str(path)], SMALL)
