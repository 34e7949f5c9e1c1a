"""A policy on a place of one's own: run, recorded, replayed, reported and shown like any other crowd."""

import json

import pytest
from commands import call, figures

from crowd_env import make_scenario
from crowd_env.agents import load
from crowd_env.agents.drivers import drive
from crowd_env.envs.rollout import run_episodes

POLICY = "competitive-door/ppo"


@pytest.fixture
def hall(tmp_path):
    path = tmp_path / "hall.wkt"
    path.write_text("POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0))")
    return f"{path} --exit 8,2.5,8,3.5 --people 12"


def test_a_policy_leads_the_people_of_a_plan_as_it_does_in_python(hall):
    found = figures(f"run {hall} --policy {POLICY} --runs 2 --json")
    place = make_scenario(hall.split()[0], exits=["8,2.5,8,3.5"], people=12)
    policy = load(POLICY)
    assert policy.trained["manner"] == "competitive"
    driver = drive(policy, place, physics="nsm2", walking="competitive")
    alone = [run.metrics.evacuation_time for run in run_episodes(place, 2, driver=driver)]
    assert found["evacuation_time"]["mean"] == pytest.approx(sum(alone) / 2, rel=1e-12)
    assert found["policy"] == POLICY and found["manner"] == "competitive"
    usual = figures(f"run {hall} --runs 2 --json")
    assert usual["evacuation_time"]["mean"] != found["evacuation_time"]["mean"] and usual["manner"] == "hurried"
    assert figures(f"run {hall} --policy {POLICY} --walking calm --runs 1 --json")["manner"] == "calm"


@pytest.mark.more
def test_its_folder_is_recorded_replayed_reported_and_gone_on_with(hall, tmp_path):
    out = tmp_path / "led"
    result = call(f"run {hall} --policy {POLICY} --runs 2 --out {out}")
    assert result.exit_code == 0 and f"led by {POLICY}" in result.stdout, result.output
    config = json.loads((out / "config.json").read_text())
    assert config["policy"]["name"] == POLICY and len(config["policy"]["sha256"]) == 64
    for line in (
        f"replay {out}",
        f"report {out} -o {tmp_path / 'a.html'}",
        f"run --config {out / 'config.json'} --runs 2",
    ):
        result = call(line)
        assert result.exit_code == 0, result.output
    other = call(f"run {hall} --runs 2 --out {out}")
    assert other.exit_code == 2 and "another command" in other.stderr


@pytest.mark.more
def test_a_place_of_ones_own_is_shown_beside_a_policy(hall, tmp_path):
    pytest.importorskip("PIL.Image")
    film = tmp_path / "a.png"
    result = call(f"show {hall} --policies shortest {POLICY} --film {film} --film-width 320 --film-fps 1")
    assert result.exit_code == 0 and film.exists(), result.output
    assert [line.split(":")[0] for line in result.stdout.splitlines()] == ["shortest", POLICY]


def test_an_unknown_policy_is_one_sentence(hall):
    result = call(f"run {hall} --policy nobody")
    assert result.exit_code == 2 and "unknown policy 'nobody'" in result.stderr and result.stderr.count("\n") == 1
