"""Controllers that send people to exits: how they are judged, trained and chosen, and the command."""

import json
import os
import signal

import numpy as np
import pytest
from routing_places import corridor, hall
from typer.testing import CliRunner

from crowd_env import SCENARIOS, CrowdEnv
from crowd_env.agents.controllers import FixedSplit, RandomController
from crowd_env.agents.evaluation.comparison import last_times, mean_times, paired
from crowd_env.agents.evaluation.evaluation import Evaluation
from crowd_env.agents.evaluation.routing import evaluate_controller
from crowd_env.agents.trained import LearnedController
from crowd_env.cli.agents import train_routing as command
from crowd_env.envs.routing.env import RoutingVectorEnv


def test_a_scripted_split_beats_the_nearest_exit():
    split, nearest = (
        evaluate_controller(c, hall(), runs=10, first_seed=1_000_000) for c in (FixedSplit(5.0), "nearest exit")
    )
    assert split.column("unfinished").sum() == nearest.column("unfinished").sum() == 0
    assert last_times(split).mean() < 0.8 * last_times(nearest).mean()
    assert mean_times(split).mean() < 0.9 * mean_times(nearest).mean()
    assert paired(last_times(split), last_times(nearest))["ci95"][1] < 0.0


def test_telling_everyone_the_nearest_exit_is_the_strategy_of_the_nearest_exit():
    """The same draws and the same physics: the controller adds nothing of its own."""
    scenario = hall(count=30)
    told = evaluate_controller(FixedSplit(10.0), scenario, runs=3, first_seed=7)
    free = evaluate_controller("nearest exit", scenario, runs=3, first_seed=7)
    np.testing.assert_array_equal(told.exit_times, free.exit_times)


@pytest.fixture
def options(monkeypatch):
    """Return options of a small hall that is known by name, as a saved controller needs it."""
    pytest.importorskip("stable_baselines3")
    monkeypatch.setitem(SCENARIOS, "small-hall", lambda *, count=12: hall(count))
    return {"scenario": "small-hall", "grid": (2, 1)}


def test_training_is_repeatable_and_keeps_its_best(tmp_path, options):
    from crowd_env.agents.learned.routing import FINAL_SEED, train_controller

    curves = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        made = train_controller(
            tmp_path / name, options, envs=2, steps=128, seconds=60.0, seed=5, eval_every=64, eval_runs=2, final_runs=3
        )
        curves.append([{key: value for key, value in row.items() if "seconds" not in key} for row in made["curve"]])
        assert json.loads((tmp_path / name / "learning_curve.json").read_text()) == made["curve"]
        assert sorted(path.name for path in (tmp_path / name).iterdir()) == ["best.safetensors", "learning_curve.json"]
    assert curves[0] == curves[1] and [row["steps"] for row in curves[0]] == [0, 64, 128]
    assert not made["interrupted"] and len(made["finalists"]) == 3 and made["best"] in made["finalists"]
    saved = LearnedController.load(tmp_path / "one" / "best.safetensors")
    judged = evaluate_controller(saved, runs=3, first_seed=FINAL_SEED, **saved.options)
    assert last_times(judged).mean() == pytest.approx(made["best"]["last"])
    assert last_times(judged).std(ddof=1) / np.sqrt(3) == pytest.approx(made["best"]["standard_error"])


def test_the_numbers_choose_as_the_model_does(options):
    from crowd_env.agents.learned.export import network_of
    from crowd_env.agents.learned.routing import RoutingSettings, make_routing_ppo

    env = RoutingVectorEnv(hall(), num_envs=2, grid=(4, 2))
    model = make_routing_ppo(env, RoutingSettings(), seed=0)
    controller = LearnedController(network_of(model), model.action_space.nvec, options)
    rows = np.random.default_rng(0).uniform(0.0, 1.0, (60, env.layout.size)).astype(np.float32)
    np.testing.assert_array_equal(controller.act(rows, env.batch, None), model.predict(rows, deterministic=True)[0])


def scripted_evaluations(monkeypatch, first, again):
    """Let judgements give the times in ``first``, and those of finalists in ``again``."""
    from crowd_env.agents.learned import routing

    times = {routing.VALIDATION_SEED: iter(first), routing.FINAL_SEED: iter(again)}
    blank = CrowdEnv(hall(count=1)).metrics(0)._replace(unfinished=0)

    def evaluate_controller(*args, runs, first_seed, **kwargs):
        exits = [np.array([next(times[first_seed])])] * runs
        return Evaluation("learned", "nsm2", [blank] * runs, exits, np.zeros(runs), 60.0)

    monkeypatch.setattr(routing, "evaluate_controller", evaluate_controller)
    return routing


def test_the_best_controller_of_many_draws_is_kept_not_the_luckiest_of_few(tmp_path, options, monkeypatch):
    routing = scripted_evaluations(monkeypatch, [10.0, 5.0, 7.0, 6.0, 9.0], [8.0, 7.5, 8.5])
    made = routing.train_controller(tmp_path, options, envs=2, steps=256, seconds=60.0, seed=5, eval_every=64)
    assert [row["last"] for row in made["curve"]] == [10.0, 5.0, 7.0, 6.0, 9.0]
    # The best three are those of 64, 192 and 128 steps; judged again that of 192 is the best of them.
    assert [row["steps"] for row in made["finalists"]] == [64, 192, 128]
    assert made["best"]["steps"] == 192 and made["best"]["runs"] == 500


def test_an_interrupted_training_keeps_its_best_and_ends(tmp_path, options, monkeypatch):
    from crowd_env.agents.learned import routing

    def interrupt(self):
        if self.num_timesteps >= 20:
            raise KeyboardInterrupt
        return True

    monkeypatch.setattr(routing.ControllerCallback, "_on_step", interrupt)
    made = routing.train_controller(tmp_path, options, envs=2, steps=128, seconds=60.0, seed=5, eval_runs=2)
    assert made["interrupted"] and made["best"]["steps"] == 0 and (tmp_path / "best.safetensors").exists()
    assert made["finalists"] == []


def test_the_learning_rate_stays_above_zero_beyond_the_budget(tmp_path, options, monkeypatch):
    from crowd_env.agents.learned import routing

    rates, update = [], routing.PPO._update_learning_rate

    def watched(self, optimizers):
        update(self, optimizers)
        rates.append(optimizers.param_groups[0]["lr"])

    monkeypatch.setattr(routing.PPO, "_update_learning_rate", watched)
    watch = {"eval_runs": 1, "final_runs": 1}
    routing.train_controller(tmp_path, options, envs=2, steps=100, seconds=60.0, seed=5, **watch)  # 128 are made
    assert len(rates) == 2 and rates[0] > 0.0 == rates[1]


def test_where_someone_is_left_inside_the_time_limit_counts():
    stuck = corridor([(1.0, 2.0), (4.0, 2.0)], speed=0.3, time_limit=4.0)
    judged = evaluate_controller("nearest exit", stuck, runs=1, first_seed=0)
    assert judged.column("unfinished").tolist() == [1.0] and last_times(judged).tolist() == [pytest.approx(4.0)]


def test_an_untrained_controller_sends_people_to_the_nearest_exit(options):
    from crowd_env.agents.learned.routing import RoutingSettings, make_routing_ppo

    env = RoutingVectorEnv(hall(), num_envs=1, grid=(4, 2))
    model = make_routing_ppo(env, RoutingSettings(), seed=0)
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    assert action.tolist() == [[0, 0, 1, 1] * 2]


# --------------------------------------------------------------------------------------------------------- the command

SMALL = ("--scenario", "small-hall", "--grid", 2, 1, "--steps", 64, "--envs", 2, "--seconds", 5)


def call(*arguments):
    from typer import Typer

    app = Typer(pretty_exceptions_enable=False)
    app.command()(command.main)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def quick(monkeypatch, options):
    """Judge on few draws while training."""
    from crowd_env.agents.learned import routing

    init = routing.ControllerCallback.__init__
    monkeypatch.setattr(
        routing.ControllerCallback,
        "__init__",
        lambda self, *args, **more: init(self, *args, eval_runs=1, final_runs=1, **more),
    )
    return options


def test_the_command_trains_judges_and_prints(tmp_path, quick):
    told = call(*SMALL, "--runs", 2, "--out", tmp_path / "run", "--json")
    assert told.exit_code == 0, told.output
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    names = [row["controller"] for row in results["rows"]]
    assert names == ["random", "nearest exit", "shortest path", "fastest path", "split at 5 m", "learned"]
    assert json.loads(told.stdout[told.stdout.index("{") :]) == results
    nearest, learned = results["rows"][1], results["rows"][-1]
    assert nearest["learned_over_this"] == pytest.approx(learned["last"]["mean"] / nearest["last"]["mean"])
    longer = learned["last"]["mean"] - nearest["last"]["mean"]
    assert nearest["learned_minus_this"]["last"]["mean"] == pytest.approx(longer)
    assert nearest["unfinished_share"]["ci95"] == pytest.approx([0.0, 0.6576], abs=1e-4)


def test_one_run_has_no_interval_and_is_no_error(tmp_path, quick):
    told = call(*SMALL, "--runs", 1, "--out", tmp_path / "run")
    assert told.exit_code == 0, (told.output, told.exception)
    for row in json.loads((tmp_path / "run" / "results.json").read_text())["rows"]:
        assert row["last"]["mean"] > 0 and row["last"]["ci95"] == [None, None]
    assert "nan" not in told.stdout and "learned" in told.stdout


def test_a_controller_is_trained_and_judged_on_a_floor_plan(tmp_path, quick):
    """Its file is evaluated on the plan with the exits that are named then."""
    from crowd_env.cli.agents import evaluate

    plan = tmp_path / "hall.wkt"
    plan.write_text("POLYGON ((0 0, 800 0, 800 400, 0 400, 0 0))")  # in cm
    place = ("--scenario", plan, "--exit", "0,150,0,250", "--exit", "800,150,800,350", "--unit", "cm", "--people", 6)
    told = call(*SMALL[2:], *place, "--runs", 1, "--out", tmp_path / "run")
    assert told.exit_code == 0, (told.output, told.exception)
    config = json.loads((tmp_path / "run" / "results.json").read_text())["config"]
    assert (config["exits"], config["unit"], config["people"]) == (["0,150,0,250", "800,150,800,350"], "cm", 6)
    words = [
        str(word) for word in (*place, "--policies", "nearest", tmp_path / "run" / "best.safetensors", "--runs", 1)
    ]
    judged = CliRunner().invoke(evaluate.app, [*words, "--json"])
    assert judged.exit_code == 0, judged.output
    assert [row["policy"] for row in json.loads(judged.stdout)["rows"]] == ["nearest", "best"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--exit", "0,1,0,2"), "has its own exits; --exit is for floor plans"),
        (("--unit", "cm"), "is in meters; --unit is for floor plans"),
        (("--seconds", -1), "--seconds -1"),
        (("--runs", 0), "--runs 0"),
        (("--seed", -1), "seed -1"),
        (("--split", "nan"), "--split nan"),
        (("--scenario", "nope"), "nope two-exit-hall-v0"),
        (("--scheme", "glue"), "glue nsm2"),
        (("--interval", 0), "interval 0"),
        (("--grid", 0, 2), "grid 0 2"),
        (("--grid", 1_000_000, 1_000_000), "--grid 10000 cells"),
        (("--scenario", "room-v0"), "room-v0 one way out"),
        (("--runs", 1_000_000), "--runs 999999"),
        (("--threads", 0), "threads 0"),
        (("--envs", 10_000_000), "--envs 10000000 --envs 16666"),
        (("--out", ".."), "cannot name a run"),
    ],
)
def test_a_mistake_leaves_no_folder_behind(tmp_path, options, arguments, words):
    told = call("--scenario", "small-hall", "--out", tmp_path / "runs" / "x", *arguments)
    assert told.exit_code == 2, (told.output, told.exception)
    assert "Traceback" not in told.stderr and all(word in told.stderr for word in words.split())
    assert not (tmp_path / "runs").exists()


def test_what_was_judged_before_an_interrupt_is_kept(tmp_path, quick, monkeypatch):
    real = command.evaluate_controller

    def interrupted(controller, **more):
        if controller == "shortest path":
            os.kill(os.getpid(), signal.SIGTERM)  # as Ctrl-C
        return real(controller, **more)

    monkeypatch.setattr(command, "evaluate_controller", interrupted)
    told = call(*SMALL, "--runs", 2, "--out", tmp_path / "run")
    assert told.exit_code == 130 and "results.json" in told.stderr and "nearest exit" in told.stdout
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert [row["controller"] for row in results["rows"]] == ["random", "nearest exit", "learned"]


def test_an_interrupt_while_training_ends_at_once_and_says_what_there_is(tmp_path, quick, monkeypatch):
    from crowd_env.agents.learned import routing

    monkeypatch.setattr(
        routing.ControllerCallback, "_on_step", lambda self: os.kill(os.getpid(), signal.SIGINT) or True
    )
    monkeypatch.setattr(command, "evaluate_controller", lambda *args, **more: pytest.fail("it goes on judging"))
    told = call(*SMALL, "--runs", 2, "--out", tmp_path / "run")
    assert told.exit_code == 130
    assert "crowd-env evaluate" in told.stderr and "run/best.safetensors" in told.stderr
    assert LearnedController.load(tmp_path / "run" / "best.safetensors")


@pytest.mark.nightly
def test_a_minute_of_training_beats_the_random_controller(tmp_path, options):
    from crowd_env.agents.learned.routing import train_controller

    options = {"scenario": "small-hall", "people": 100}
    train_controller(tmp_path, options, envs=16, steps=20_000, seconds=60.0, seed=0, eval_every=4096, eval_runs=20)
    learned, random, nearest = (
        evaluate_controller(controller, runs=30, first_seed=1_000_000, **options)
        for controller in (LearnedController.load(tmp_path / "best.safetensors"), RandomController(), "nearest exit")
    )
    for other in (random, nearest):
        assert paired(last_times(learned), last_times(other))["ci95"][1] < 0.0
    assert learned.column("unfinished").sum() == 0
