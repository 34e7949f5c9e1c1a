"""The crowd on a footbridge: where the sway begins, and what starts it."""

import pytest
from reproductions import check_files, reported

from crowd_env.envs.footbridge.env import FootbridgeEnv
from crowd_env.reproduce.footbridge.gate import RULES, keep
from crowd_env.reproduce.footbridge.onset import THRESHOLD, at_mid_span, on_filled_deck
from crowd_env.reproduce.footbridge.runs import onset


def test_the_onset_is_read_where_the_motion_stays_large():
    assert onset([10, 20, 30, 40], [0.0, 2.0, 0.0, 2.0], 1.0) == pytest.approx(35.0)
    assert onset([10, 20], [0.0, 0.5], 1.0) is None and onset([10, 20], [2.0, 3.0], 1.0) is None


@pytest.mark.more
def test_rules_at_the_gate_are_compared(folder):
    object = reported("bridge-gate --runs 1 --set people=120 --set duration=20 --out reproduce")
    check_files(object, folder)
    here = {row["quantity"]: row["here"] for row in object["rows"]}
    for name in RULES:
        bad = here[f"{name}: discomfort"]
        assert here[f"{name}: reward"] == pytest.approx(here[f"{name}: people across"] - 0.02 * bad)


@pytest.mark.nightly
def test_to_hold_people_back_keeps_the_deck_still_and_pays():
    env = FootbridgeEnv(700, time_limit=300.0)
    free, held = (keep(RULES[name], env, 0) for name in ("open", "count"))
    across, _, reward, sway, _ = range(5)
    assert held[:, sway].max() < 0.01 < 0.05 < free[:, sway].max()
    assert held[:, across].sum() < free[:, across].sum() and held[:, reward].sum() > 500.0 > free[:, reward].sum()


@pytest.mark.nightly
def test_the_deck_begins_to_sway_near_the_threshold():
    mid = at_mid_span(range(4), 400.0, (90, 130, 150, 170, 190, 250))
    assert mid.amplitude[0].max() < 0.01 and mid.amplitude[-1].min() > 0.05
    assert 130 < mid.onset() < 190 and mid.critical == pytest.approx(149.0, abs=0.5)
    filled = on_filled_deck(range(3), 400.0, (200, 260, 320, 380, 450))
    assert filled.onset() == pytest.approx(2.0 * THRESHOLD, rel=0.25)


@pytest.mark.more
def test_bodies_that_balance_need_no_steps_in_time(folder):
    object = reported("bridge-rival --set duration=320 --out reproduce")
    check_files(object, folder)
    here = {row["quantity"]: row["here"] for row in object["rows"]}
    assert here["walkers when it sways, pendulum"] < here["walkers when it sways, synchrony"]
    assert here["R sqrt(N) then, pendulum"] < 2.0 < 3.0 < here["R sqrt(N) then, synchrony"]


@pytest.mark.more
def test_a_crowd_is_filmed(folder):
    object = reported("bridge-deck --set people=30 --set duration=3 --out reproduce")
    check_files(object, folder)
    assert (folder / "reproduce" / "bridge-deck.gif").read_bytes()[:3] == b"GIF"
    assert object["rows"][0]["here"] == pytest.approx(30.0, abs=3.0)
