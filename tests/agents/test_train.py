"""The main job: what a training run leaves behind, and that it can be stopped and gone on with."""

import json
import subprocess
import sys
from dataclasses import replace
from functools import partial

import gymnasium
import numpy as np
import pytest
from cases import looped
from late import late
from repository import ROOT
from training_runs import call, checkpoint, curve, tiny, with_ppo

from crowd_env import SCENARIOS, SCHEMES, Simulation, make_scenario, make_scheme
from crowd_env.agents import PRETRAINED, make_policy, runs, training_config
from crowd_env.agents.evaluation.comparison import last_times, minus_first
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.networks import read_network
from crowd_env.agents.tasks import PRESETS, TASKS
from crowd_env.agents.training_config import make_env
from crowd_env.cli.agents import learn
from crowd_env.core.files.json_file import read_json
from crowd_env.envs.action import make_action

PPO = late("stable_baselines3", "PPO")
Logger = late("stable_baselines3.common.logger", "Logger")
FallingRate = late("crowd_env.agents.learned.ppo", "FallingRate")
training = late("crowd_env.agents.learned.training")
callbacks, curves = late("crowd_env.agents.learned.callbacks"), late("crowd_env.agents.learned.curve")
CrowdVecEnv, MaskedRolloutBuffer = late("crowd_env.envs.adapters.sb3", "CrowdVecEnv", "MaskedRolloutBuffer")

# ------------------------------------------------------------------------------------------------------ the whole job


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """A whole run from the command line, as small as can be."""
    root = tmp_path_factory.mktemp("runs")
    options = ("--scenario", "room-v0", "--minutes", 30, "--steps", 3000, "--envs", 2, "--runs", 2, "--seed", 7)
    result = call(*options, "--out", root / "tiny")
    assert result.exit_code == 0, result.output
    return root, result


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("task", "steps", "most"),
    [("narrow-door", None, 39.5), ("counter-flow", None, 20.9), ("competitive-door", 6_000_000, 70.0)],
)
def test_ppo_alone_learns_from_full_speed(task, steps, most, tmp_path):
    """Seed 0 took 37, 19.9 and 63.5 s; two epochs of 8192 take 21.9 and 76 in the last two."""
    budget = {"steps": steps, "minutes": 120.0, "eval_every": 2_000_000}
    assert training.train_here(tmp_path, training_config.task_config(task, seed=0, start="rule", **budget))
    best = curves.best_row(curve(tmp_path))
    assert best["unfinished"] == 0 and best["evacuation_time"] < most


@pytest.mark.more
def test_a_run_leaves_model_config_results_curves_and_film(job):
    root, _ = job
    folder = root / "tiny"
    left = {path.name for path in folder.iterdir()}
    pictures = {"learning_curve.png", "egress_curves.png", "evacuation.gif"}
    assert {"best.safetensors", "checkpoint.pt", "config.json", "results.json", "learning_curve.csv"} | pictures <= left
    assert not [name for name in left if "part" in name]
    assert list((folder / "tensorboard").glob("events*"))
    assert (folder / "evacuation.gif").read_bytes()[:3] == b"GIF"
    assert all((folder / name).read_bytes()[:4] == b"\x89PNG" for name in pictures if name.endswith("png"))
    _, facts = read_network(folder / "best.safetensors")
    assert {"scenario": "room-v0", "scheme": "nsm2", "dt": 0.01, "seed": 7}.items() <= facts["trained"].items()


@pytest.mark.more
def test_the_config_holds_every_parameter(job):
    config = json.loads((job[0] / "tiny" / "config.json").read_text())
    assert (
        config["seed"] == 7 and config["envs"] == 2 and config["scenario"] == "room-v0" and config["scheme"] == "nsm2"
    )
    assert {"dt", "decision_dt", "frame", "action", "observation", "reward", "ppo", "versions", "steps"} <= set(config)
    assert {"learning_rate", "gamma", "gae_lambda", "n_steps", "batch_size"} <= set(config["ppo"])


@pytest.mark.more
def test_a_run_names_the_commit_of_its_checkout_and_keeps_every_network_that_it_judged(job, monkeypatch, tmp_path):
    folder = job[0] / "tiny"
    asked = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    named = json.loads((folder / "config.json").read_text())["versions"]["commit"]
    assert (named or "").removesuffix("-dirty") == asked.stdout.strip()
    steps = {f"{row['steps']:.0f}.safetensors" for row in curve(folder)}
    assert {path.name for path in (folder / "looks").iterdir()} == steps
    assert read_network(folder / "looks" / "0.safetensors")[1] == read_network(folder / "start.safetensors")[1]
    monkeypatch.setattr(runs, "__file__", str(tmp_path / "runs.py"))  # installed, in a folder of somebody's project
    assert runs.commit.__wrapped__() is None


@pytest.mark.more
def test_the_results_compare_all_policies_on_the_same_held_out_draws(job):
    root, result = job
    told = json.loads((root / "tiny" / "results.json").read_text())
    rows = {row["policy"]: row for row in told["rows"]}
    assert set(rows) == {"random", "stand-still", "shortest", "learned:sampled", "learned"}
    assert rows["stand-still"]["unfinished"] == 40
    assert evaluate(make_policy("shortest"), runs=2).row().items() <= rows["shortest"].items()
    learned, shortest = (
        evaluate(make_policy(name), runs=2) for name in (str(root / "tiny" / "best.safetensors"), "shortest")
    )
    assert (learned.row() | {"policy": "learned"}).items() <= rows["learned"].items()
    assert told["learned_minus_rule"] == json.loads(json.dumps(minus_first(learned, shortest)))
    assert told["learned_over_rule"] == pytest.approx(last_times(learned).mean() / last_times(shortest).mean())
    assert all(name in result.stdout for name in rows)


@pytest.mark.more
def test_the_learning_curve_has_a_row_before_and_after(job):
    rows = curve(job[0] / "tiny")
    assert tuple(rows[0]) == curves.CURVE_COLUMNS
    assert rows[0]["steps"] == 0 and rows[-1]["steps"] >= 3000
    assert (np.diff([row["steps"] for row in rows]) > 0).all()


@pytest.mark.more
def test_the_learning_curve_says_how_sure_it_is(job):
    row = curve(job[0] / "tiny")[0]
    best = make_policy(str(job[0] / "tiny" / "best.safetensors"))
    config = json.loads((job[0] / "tiny" / "config.json").read_text())
    assert config["eval_runs"] == 500 and config["validation_seed"] == 2_000_000
    times = last_times(evaluate(best, runs=500, first_seed=2_000_000))
    assert min(row["evacuation_time"] for row in curve(job[0] / "tiny")) == pytest.approx(times.mean())
    assert row["standard_error"] == pytest.approx(times.std(ddof=1) / np.sqrt(500), rel=0.5)


@pytest.mark.more
def test_the_same_name_twice_overwrites_nothing(job, monkeypatch):
    root, _ = job
    monkeypatch.setitem(learn.BACKENDS, "native", lambda *args: False)  # as if interrupted at once
    before = {path: path.stat().st_mtime_ns for path in (root / "tiny").rglob("*")}
    result = call("--out", root / "tiny", "--scenario", "room-v0")
    assert result.exit_code == 130
    assert (root / "tiny-2" / "config.json").exists()
    assert {path: path.stat().st_mtime_ns for path in (root / "tiny").rglob("*")} == before


@looped("scheme", SCHEMES)
def test_the_physics_step_is_that_of_the_scheme(scheme):
    begun = partial(training_config.default_config, "room-v0", scheme, 0, 2, 100, 1.0)
    assert begun().dt == make_scheme(scheme).info.default_dt and begun(dt=0.005).dt == 0.005


@pytest.mark.more
@looped(("asked", "dt"), [(("--scheme", "dem", "--set", "dt=0.005"), 0.005), (("--scheme", "hertz"), 0.005)])
def test_training_table_curve_and_film_use_the_same_physics_step(tmp_path, monkeypatch, asked, dt):
    seen, init = set(), Simulation.__init__
    default = training_config.default_config

    def watched(self, *args, physics, **options):
        seen.add(physics.dt)
        init(self, *args, physics=physics, **options)

    def smaller(*args, **given):
        config = with_ppo(default(*args, **given), n_steps=4)
        return replace(config, eval_runs=1, scenario="small-room", people=3)

    monkeypatch.setitem(SCENARIOS, "small-room", lambda: make_scenario("room-v0", people=3, time_limit=6.0))
    monkeypatch.setattr(Simulation, "__init__", watched)
    monkeypatch.setattr("crowd_env.agents.evaluation.evaluation._warm_up", lambda *args: None)  # in a room of its own
    monkeypatch.setattr(training_config, "default_config", smaller)
    result = call(*asked, "--scenario", "room-v0", "--steps", 20, "--envs", 1, "--runs", 1, "--out", tmp_path / str(dt))
    assert result.exit_code == 0, result.output
    assert seen == {dt}


@pytest.mark.more
def test_the_reward_of_the_curve_is_the_mean_return_of_all_episodes(tmp_path, monkeypatch):
    returns, step = [], CrowdVecEnv.step_wait

    def watched(self):
        answer = step(self)
        returns.extend(info["episode"]["r"] for info in answer[3] if "episode" in info)
        return answer

    monkeypatch.setattr(CrowdVecEnv, "step_wait", watched)
    folder = tmp_path / "run"
    assert learn.train(folder, tiny(folder, steps=7680, eval_every=10**9))
    rows = curve(folder)
    assert len(rows) == 2 and rows[-1]["episodes"] == len(returns) > 20
    assert rows[-1]["reward"] == pytest.approx(np.mean(returns))


@pytest.mark.more
def test_the_log_says_how_far_actions_run_into_their_bounds(tmp_path, monkeypatch):
    """Against the actions that were drawn for people inside, and clipped for the environment."""
    logged, drawn, record, add = [], [], Logger.record, MaskedRolloutBuffer.add

    def watched(self, key, value, exclude=None):
        if key == "rollout/clipped_share":
            logged.append([value])
        elif key.startswith("rollout/raw_action"):
            logged[-1].append(value)
        return record(self, key, value, exclude)

    def added(self, obs, action, reward, *others):
        drawn.append(action[reward.slots.acted])
        return add(self, obs, action, reward, *others)

    monkeypatch.setattr(Logger, "record", watched)
    monkeypatch.setattr(MaskedRolloutBuffer, "add", added)
    folder = tmp_path / "run"
    assert learn.train(folder, tiny(folder, steps=2560, eval_every=10**9))
    assert len(logged) == 2 and len(drawn) == 64  # two rollouts of 32 steps
    for row, steps in zip(logged, (drawn[:32], drawn[32:]), strict=True):
        actions = np.concatenate(steps)
        clipped = (np.clip(actions, -1.0, 1.0) != actions).any(axis=1)
        np.testing.assert_allclose(row, [clipped.mean(), *actions.mean(axis=0)], atol=1e-5)
        assert 0.3 < row[0] < 0.9 and 0.7 < row[1] < 1.3  # it starts at the bound


def test_choices_have_no_bounds_to_run_into():
    assert training.saturation(None, gymnasium.spaces.Discrete(5)) == {}


@pytest.mark.more
def test_a_finished_run_can_be_judged_again(job):
    root, _ = job
    before = (root / "tiny" / "learning_curve.csv").read_bytes()
    result = call("--resume", root / "tiny", "--runs", 1)
    assert result.exit_code == 0, result.output
    assert (root / "tiny" / "learning_curve.csv").read_bytes() == before
    assert json.loads((root / "tiny" / "results.json").read_text())["rows"][0]["runs"] == 1


def test_the_curve_of_a_search_says_how_good_it_was_in_the_end_and_before(tmp_path):
    config = tiny(tmp_path / "run", eval_runs=2)
    callback = callbacks.RunCallback(tmp_path / "run", config, None)
    callback.on_search(0, make_policy("shortest"))
    callback.on_search(900, make_policy("headway"))
    rows = curves.read_curve(tmp_path / "run" / curves.SEARCH)
    assert [row["steps"] for row in rows] == [0, 900] and rows[0]["evacuation_time"] != rows[1]["evacuation_time"]
    assert not callback.curve and not (tmp_path / "run" / curves.CURVE).exists()  # no network was judged


@pytest.mark.more
def test_training_stops_when_its_time_is_up(tmp_path):
    folder = tmp_path / "run"
    config = tiny(folder, minutes=0.02, steps=10**9, eval_every=10**9)
    assert learn.train(folder, config)  # 10**9 steps would take days
    assert 0 < curve(folder)[-1]["steps"] < 10**9


@pytest.mark.more
def test_no_point_of_the_curve_is_measured_twice(tmp_path):
    folder = tmp_path / "run"
    assert learn.train(folder, tiny(folder, eval_every=1280))  # a point at every rollout, and one at the end
    assert [row["steps"] for row in curve(folder)] == [0, 1280, 2560, 3840, 5120]


@pytest.mark.more
def test_the_same_seed_trains_the_same_policy_however_fast_the_machine_is(tmp_path, monkeypatch):
    for name, share in (("one", 0.0), ("two", 0.45)):
        config = tiny(tmp_path / name)
        monkeypatch.setattr(callbacks.RunCallback, "seconds", share * 60.0 * config.minutes)
        learn.train(tmp_path / name, config)
    one, two = (checkpoint(tmp_path / name)["policy"] for name in ("one", "two"))
    assert all((one[key] == two[key]).all() for key in one)


# ----------------------------------------------------------------------------------------------------------- mistakes


@looped(
    ("args", "words"),
    [
        (("--scenario", "hall"), "hall room-v0"),
        (("--scheme", "glue"), "glue nsm2"),
        (("--seed", -1), "seed -1"),
        (("--seed", 1_000_000), "seed 999999"),
        (("--minutes", 0), "--minutes > 0"),
        (("--minutes", "nan"), "--minutes > 0"),
        (("--minutes", "inf"), "--minutes finite"),
        (("--steps", 0), "--steps > 0"),
        (("--envs", -2), "--envs > 0"),
        (("--runs", 0), "--runs 0 999999"),
        (("--runs", 1_000_000), "--runs 999999"),
        (("--set", "dt=1e-9"), "--set dt 1e-09 1e-05"),
        (("--set", "dt=nan"), "--set dt nan"),
        (("--set", "dt=0"), "--set dt 0.0 1e-05"),
        (("--set", "dt=0.03"), "0.03 0.1"),
        (("--scenario", "room-v0", "--envs", 10_000_000), "--envs 200000000 at most 200000 --envs 10000"),
        (("--decides", "pushing"), "unknown --decides pushing walking routing"),
        (("--set", "grid=2,1"), "--set grid --decides routing"),
        (("--set", "runners=2"), "--set runners=2 --backend rllib"),
        (("--set", "tolerance=2"), "tolerance dt outline"),
        (("--decides", "routing", "--start", "follow"), "--start follow nearest exits"),
        (("--decides", "routing", "--scenario", "room-v0"), "nothing to choose"),
        (("--decides", "routing", "--set", "grid=1000,1000"), "--set grid"),
        (("--task", "floor"), "no preset floor competitive-door"),
        (("--scenario", "room-v0", "--people", 5), "--people 5 scenario says"),
        (("--people", 5000), "5000 people do not fit"),
        (("--threads", 0), "--threads 0"),
    ],
)
def test_a_mistake_is_answered_plainly_before_anything_is_written(tmp_path, args, words):
    result = call("--out", tmp_path / "runs" / "one", *args)
    assert result.exit_code == 2, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    for word in words.split():
        assert word in result.stderr.replace("\n", "")
    assert not (tmp_path / "runs").exists()


@pytest.mark.more
def test_a_task_is_trained_by_its_preset_and_judged_as_it_stands(tmp_path, monkeypatch):
    """Trained with other people and another physics step than it is judged with."""
    seen, init = [], Simulation.__init__

    def watched(self, scenarios, *args, physics, **options):
        init(self, scenarios, *args, physics=physics, **options)
        seen.append((physics.dt, self.bodies.env_start[1]))

    monkeypatch.setattr(Simulation, "__init__", watched)
    monkeypatch.setattr("crowd_env.agents.evaluation.evaluation._warm_up", lambda *args: None)  # in a room of its own
    monkeypatch.setattr("crowd_env.agents.drivers.SHARES", (1.0,))
    monkeypatch.setattr("crowd_env.agents.drivers.SEARCH_RUNS", 1)
    options = ("--task", "literal-room", "--people", 6, "--steps", 700, "--envs", 1, "--runs", 1, "--threads", 1)
    monkeypatch.chdir(tmp_path)
    result = call(*options)
    assert result.exit_code == 0, result.output
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name == "literal-room-hertz-literal-seed0"
    config = json.loads((folder / "config.json").read_text())
    assert (config["task"], config["people"], config["dt"], config["action"]) == ("literal-room", 6, 0.01, "speeds")
    assert config["reward"]["weights"]["contact"] > 0.0 and "ahead" in config["observation"]["terms"]
    assert set(seen) == {(0.01, 6), (0.01, 20), (0.005, 20)}  # trained, validated, judged
    rows = json.loads((folder / "results.json").read_text())["rows"]
    names = ["rule", "rule-best-speed", "density-cap", "headway", "follow", "evolution", "yield-when-stuck", "zipper"]
    names += ["learned:sampled", "learned"]
    assert [row["policy"] for row in rows] == names
    assert all(row["people"] == 20 and row["task"] == "literal-room" for row in rows)
    assert "literal-room, version 3" in result.stdout


@pytest.mark.more
@looped("task", PRESETS)
def test_presets_train_in_the_place_of_their_task(task):
    config = training_config.task_config(task)
    judged = TASKS[task]
    same = config.options.keys() - {"blocked_after"}  # when a room begins anew is no part of the place
    assert same == judged.options.keys() and config.scheme == judged.scheme
    assert config.strategy == judged.rule and config.decision_dt == judged.decision_dt
    env = make_env(config, envs=1)
    assert env.num_people == config.people <= judged.people
    assert env.action_kind.name == make_action(config.action).name


def test_a_place_that_cannot_hold_folders_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    result = call("--out", tmp_path / "file" / "one", "--envs", 1)
    assert result.exit_code == 2 and "cannot make the folder" in result.stderr and "Traceback" not in result.stderr


@pytest.mark.more
@looped("library", ["stable_baselines3", "torch", "matplotlib"])
def test_a_library_that_is_missing_is_named_before_anything_is_written(tmp_path, library):
    program = f"import sys; sys.modules['{library}'] = None; sys.argv[1:] = ['--out', {str(tmp_path / 'runs/one')!r}]; "
    program += "import train; train.app()"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and not (tmp_path / "runs").exists()
    assert f"needs {library}" in done.stderr and "pip install" in done.stderr and "Traceback" not in done.stderr


def test_the_run_of_a_scenario_file_is_named_after_it(tmp_path, monkeypatch):
    monkeypatch.setitem(learn.BACKENDS, "native", lambda *args: False)  # as if interrupted at once
    file = tmp_path / "plans" / "hut.toml"
    file.parent.mkdir()
    plan = "geometry = { walkable = { box = [0, 0, 5, 5] }, exits = { door = [[5, 2], [5, 3]] } }"
    file.write_text(plan + "\npopulation = { people = 5 }\n")
    monkeypatch.chdir(tmp_path)
    assert call("--scenario", file, "--envs", 1).exit_code == 130
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["hut-nsm2-seed0"]
    assert [path.name for path in file.parent.iterdir()] == ["hut.toml"]


def test_the_learning_rate_never_falls_below_zero_and_follows_the_larger_spent_share():
    rate = FallingRate(1e-3)
    assert [rate(left) for left in (1.0, 0.25, 0.0, -0.01)] == pytest.approx([1e-3, 2.5e-4, 0.0, 0.0])
    rate.spent = 0.6
    assert rate(0.9) == pytest.approx(4e-4) and rate(0.1) == pytest.approx(1e-4)
    rate.spent = 1.2
    assert rate(0.9) == 0.0


@pytest.mark.more
def test_the_learning_rate_falls_with_the_time_where_that_runs_out_first(tmp_path, monkeypatch):
    rates, update, steps = [], PPO._update_learning_rate, [0]

    def watched(self, optimizers):
        update(self, optimizers)
        rates.append(optimizers.param_groups[0]["lr"])

    monkeypatch.setattr(PPO, "_update_learning_rate", watched)
    step = training._Updates._on_step

    def counted(self):
        steps.append(self.num_timesteps)
        return step(self)

    monkeypatch.setattr(callbacks.RunCallback, "seconds", property(lambda self: steps[-1] / 100.0))
    monkeypatch.setattr(training._Updates, "_on_step", counted)
    folder = tmp_path / "run"
    config = tiny(folder, steps=10**6, minutes=1.0, eval_every=10**9)  # 60 s are over after 6000 of the steps
    assert learn.train(folder, config)
    full, rollout = config.ppo.learning_rate, 32 * 40
    assert rates == pytest.approx(
        [full * min(1.0 - k * rollout / 1e6, 2.0 - 2.0 * k * rollout / 6000) for k in range(1, 5)]
    )


@looped("name", PRETRAINED)
def test_the_stored_parameters_of_shipped_policies_are_read_as_they_are(name):
    stored = {"places": None} | read_json(PRETRAINED[name].with_suffix(".json"))["config"]
    assert training_config.TrainingConfig(**stored).as_table() == stored


@looped(
    ("field", "value", "words"),
    [
        ("envs", "two", "envs is 'two'"),
        ("seed", -1, "seed is -1; it must be 0 to 999999"),
        ("dt", 0.0, "dt is 0.0"),
        ("ppo", {"smell": 1}, "unknown key 'smell'"),
    ],
)
def test_parameters_that_cannot_be_are_refused(field, value, words):
    config = training_config.default_config("room-v0", "nsm2", 0, 2, 100, 1.0)
    with pytest.raises(ValueError, match=words):
        replace(config, **{field: value})
