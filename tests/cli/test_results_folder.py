"""``crowd-env run --out``: what was run, kept run by run, gone on with, and run again from its config."""

import json

import pytest
from cases import looped
from commands import call, figures
from plan_files import room_drawing

from crowd_env.cli import run as running
from crowd_env.cli.place import CrowdOptions, setting_of
from crowd_env.envs.rollout import RunsInterrupted, run_episodes

RUN = "run two-exit-hall-v0 --scheme dem --people 6 --seed 3"
FILES = {"crowding", "config.json", "exits.csv", "nt.csv", "nt.png", "recordings", "runs", "runs.csv", "summary.json"}


def tables(folder):
    return {name: (folder / name).read_text() for name in ("runs.csv", "exits.csv", "nt.csv")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return a folder of four runs that nothing has interrupted."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    assert call(f"{RUN} --runs 4 --out {folder}").exit_code == 0
    return folder


@pytest.mark.more
def test_the_folder_holds_what_was_run_and_what_came_of_it(whole, tmp_path):
    told = call(f"{RUN} --runs 4 --out {tmp_path} --json")
    assert (
        told.exit_code == 0
        and told.stderr.startswith("files: ")
        and told.stderr.splitlines()[1:] == [f"recording: {tmp_path / 'recordings' / 'run-0.sqlite'}"]
    )
    assert {path.name for path in tmp_path.iterdir()} == FILES
    assert json.loads(told.stdout) == json.loads((tmp_path / "summary.json").read_text())
    assert tables(tmp_path) == tables(whole)
    config = json.loads((tmp_path / "config.json").read_text())
    assert (config["seed"], config["runs"], config["scheme"]["name"], config["dt"]) == (3, 4, "dem", 0.01)
    assert config["arguments"]["scenario"] == "two-exit-hall-v0" and config["population"][0]["people"] == 6


def test_clogging_reads_the_exits(whole):
    told = json.loads(call(f"clogging {whole} --json").stdout)["sets"][0]
    assert (told["name"], told["runs"], told["exits"]) == (whole.name, 4, 24)


@pytest.mark.more
def test_an_interrupted_command_goes_on_where_it_was(whole, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:

        def stop_at_two(*args, only, **options):
            run_episodes(*args, only=only[:1], **options)
            if only != [0]:
                raise KeyboardInterrupt

        patch.setattr(running, "run_episodes", stop_at_two)
        stopped = call(f"{RUN} --runs 4 --out {tmp_path}")
    assert (
        stopped.exit_code == 130 and "2 of 4 runs are finished" in stopped.stderr and "; to go on: " in stopped.stderr
    )
    assert "two-exit-hall-v0: 6 people, dem, 2 runs" in stopped.stdout
    assert json.loads((tmp_path / "summary.json").read_text())["interrupted_of"] == 4
    made = []
    monkeypatch.setattr(
        running, "run_episodes", lambda *a, only, **b: made.extend(only) or run_episodes(*a, only=only, **b)
    )
    again = call(f"{RUN} --runs 4 --out {tmp_path}")
    assert again.exit_code == 0 and f"{tmp_path}: 2 of 4 runs are finished" in again.stderr and len(made) == 2
    assert tables(tmp_path) == tables(whole)
    assert (tmp_path / "summary.json").read_text() == (whole / "summary.json").read_text()


@pytest.mark.more
def test_what_is_whole_is_computed_again_only_to_be_recorded(whole, monkeypatch):
    made = []
    monkeypatch.setattr(
        running, "run_episodes", lambda *a, only, **b: made.extend(only) or run_episodes(*a, only=only, **b)
    )
    before = tables(whole)
    assert call(f"{RUN} --runs 4 --out {whole} --record 0").exit_code == 0 and made == []
    assert call(f"{RUN} --runs 4 --out {whole} --record 2").exit_code == 0 and made == [1]
    assert tables(whole) == before


def test_a_folder_of_another_command_is_refused(whole):
    before = {path: path.read_bytes() for path in whole.rglob("*.*")}
    refused = call(f"{RUN} --runs 4 --routing nearest --out {whole}")
    assert refused.exit_code == 2 and refused.stdout == "" and refused.stderr.count("\n") == 1
    assert "holds results of another command: strategy is shortest there and nearest here" in refused.stderr
    assert {path: path.read_bytes() for path in whole.rglob("*.*")} == before


def test_a_config_with_an_unknown_option_names_it(whole, tmp_path):
    config = json.loads((whole / "config.json").read_text())
    config["arguments"]["pace"] = 2
    (tmp_path / "config.json").write_text(json.dumps(config))
    refused = call(f"run --config {tmp_path / 'config.json'}")
    assert refused.exit_code == 2 and "arguments: unknown key 'pace'; known: scenario, exit," in refused.stderr


def test_a_mistake_makes_no_folder(tmp_path):
    for line in ("--routing glue", "--set dt=0.03", "--runs 0", "--record first"):
        assert call(f"run --people 2 {line} --out {tmp_path / 'out'}").exit_code == 2
    assert call(f"run --people 2 --out {__file__}").exit_code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.more
def test_an_error_loses_no_run_that_was_finished(monkeypatch, tmp_path):
    def fails(*_, only, keep=None, **options):
        found = run_episodes(*_, only=only[:2], keep=keep, **options)
        if len(only) > 1:  # not the first one, alone
            raise ValueError("a process has died")
        return found

    monkeypatch.setattr(running, "run_episodes", fails)
    result = call(f"{RUN} --runs 6 --out {tmp_path}")
    assert result.exit_code == 2 and result.stderr == "error: a process has died\n"
    assert len(list((tmp_path / "runs").iterdir())) == 3


def test_a_full_disk_loses_no_figures(monkeypatch, tmp_path):
    def full(path, content):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("crowd_env.core.files.store.write_json", full)
    monkeypatch.setattr("crowd_env.analysis.results.folder.write_json", full)
    result = call(f"{RUN} --runs 3 --out {tmp_path} --json")
    assert result.exit_code == 2 and json.loads(result.stdout)["runs"] == 3
    assert result.stderr.splitlines() == [
        f"note: cannot write into {tmp_path}: No space left on device",
        f"error: {tmp_path / 'config.json'}: No space left on device",
    ]


@pytest.mark.more
def test_a_config_runs_the_same_again(whole, tmp_path):
    config = whole / "config.json"
    told = call(f"run --config {config} --out {tmp_path}")
    assert told.exit_code == 0, told.stderr
    assert tables(tmp_path) == tables(whole) and "note" not in told.stderr
    changed = call(f"run --config {config} --seed 4 --runs 1 --json")
    assert json.loads(changed.stdout)["seed"] == 4 and json.loads(changed.stdout)["runs"] == 1
    assert "seed is 3 there and 4 here" in changed.stderr


@pytest.mark.more
def test_a_plan_in_a_file_is_found_from_anywhere(tmp_path, monkeypatch):
    plan, starts = tmp_path / "plan.geojson", tmp_path / "starts.csv"
    floor = {"type": "Polygon", "coordinates": [[[0, 0], [6, 0], [6, 5], [0, 5], [0, 0]]]}
    levels = [{"type": "Feature", "properties": {"level": k}, "geometry": floor} for k in (0, 1)]
    plan.write_text(json.dumps({"type": "FeatureCollection", "features": levels}))
    starts.write_text("x,y\n1,1\n1,4\n")
    (tmp_path / "away").mkdir()
    monkeypatch.chdir(tmp_path)
    line = "run plan.geojson:1 --exit 6,2,6,3 --exit 0,1,0,2 --starts starts.csv --runs 1 --set signs=no --out out"
    assert call(line).exit_code == 0
    monkeypatch.chdir(tmp_path / "away")
    told = call("run --config ../out/config.json --out ../again")
    assert told.exit_code == 0, told.stderr
    assert tables(tmp_path / "again") == tables(tmp_path / "out") and "note" not in told.stderr
    files = json.loads((tmp_path / "out" / "config.json").read_text())["files"]
    assert set(files) == {str(plan), str(starts)} and all(len(digest) == 64 for digest in files.values())


@pytest.mark.more
def test_what_was_noted_of_a_plan_stays_with_its_results(tmp_path):
    """Whoever reads the results later has to know in which unit the plan was taken."""
    drawing = room_drawing(tmp_path / "room.dxf", 2, 3.28)
    told = call(f"run {drawing} --people 2 --runs 1 --scheme dem --out {tmp_path / 'out'}")
    (note,) = json.loads((tmp_path / "out" / "config.json").read_text())["notes"]
    assert note.startswith("taken as feet, as the file says") and f"note: {note}" in told.stderr


def test_a_config_that_names_options_otherwise_is_run_again(tmp_path):
    arguments = {"scenario": "room-v0", "crowd": "calm", "physics": "dem", "people": 4}
    (tmp_path / "config.json").write_text(json.dumps({"version": "0.1.0", "arguments": arguments}))
    again = figures(f"run --config {tmp_path / 'config.json'} --runs 1")
    assert (again["manner"], again["scheme"], again["people"]) == ("calm", "dem", 4)
    place, physics, *_ = setting_of(CrowdOptions.of_config(arguments))
    assert (place.manner, physics.law.info.name, place.population.people) == ("calm", "dem", 4)


@looped("text", ["", "[1]", "{}", '{"version": "0.1.0", "arguments": {"law": "dem"}}'])
def test_what_is_no_config_is_refused(text, tmp_path):
    (tmp_path / "config.json").write_text(text)
    refused = call(f"run --config {tmp_path / 'config.json'}")
    assert refused.exit_code == 2 and refused.stderr.count("\n") == 1 and "config" in refused.stderr


# ---------------------------------------------------------------------------------------------------------- processes


@pytest.mark.more
def test_results_do_not_depend_on_the_number_of_processes(whole, monkeypatch, tmp_path):
    monkeypatch.setattr(running, "_WORTH_A_PROCESS", 0.0)
    started = []
    processes = running.Processes
    monkeypatch.setattr(running, "Processes", lambda workers: started.append(workers) or processes(workers))
    for workers, expected in ((1, []), (3, [3])):
        started.clear()
        assert call(f"{RUN} --runs 4 --workers {workers} --out {tmp_path / str(workers)}").exit_code == 0
        assert started == expected and tables(tmp_path / str(workers)) == tables(whole)


def test_a_handful_of_small_runs_starts_no_process(monkeypatch):
    monkeypatch.setattr(running, "Processes", None)
    assert figures("run --scheme dem --people 5 --runs 20 --workers 8")["runs"] == 20


def test_an_interruption_keeps_runs_of_a_batch_that_were_finished():
    from crowd_env import make_scenario
    from crowd_env.envs.rollout import make_batches, simulate_batch

    place = make_scenario("room-v0", people=3)
    (batch,) = make_batches(place, 8, scheme="dem", workers=1)
    asked = []
    done = simulate_batch(batch, lambda: asked.append(1) or len(asked) > 30)
    expected = run_episodes(place, 8, scheme="dem")
    assert 0 < len(done.episodes) < 8
    assert [repr(one) for one in done.episodes] == [repr(expected[one.run]) for one in done.episodes]
    with pytest.raises(RunsInterrupted, match="0 of 8"):
        run_episodes(place, 8, scheme="dem", keep=lambda _: None, driver=_interrupts)


def _interrupts(num_envs):
    raise KeyboardInterrupt


def test_the_version_is_told():
    import crowd_env

    assert call("--version").stdout == f"crowd-env {crowd_env.__version__}\n"
