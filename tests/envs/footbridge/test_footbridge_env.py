"""The gatekeeper of the swaying deck: what is seen of it, what a closed gate does, and what is paid."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from crowd_env.envs.footbridge.crossing import Footbridge
from crowd_env.envs.footbridge.deck import Deck
from crowd_env.envs.footbridge.env import COMFORT, DeckLayout, FootbridgeEnv
from crowd_env.envs.footbridge.pendulum import Pendulum
from crowd_env.envs.footbridge.synchrony import Synchrony
from crowd_env.envs.footbridge.walkers import DECK


def test_gymnasium_makes_it_and_the_same_seed_gives_the_same_run():
    env = gymnasium.make("crowd_env/footbridge-gate-v0", people=20, interval=0.5, time_limit=2.0).unwrapped
    check_env(env, skip_render_check=True)
    runs = []
    for _ in range(2):
        first, _ = env.reset(seed=3)
        steps = [env.step(1) for _ in range(4)]
        runs.append(np.array([first, *(step[0] for step in steps)]))
        assert [step[3] for step in steps] == [False, False, False, True]
    assert (runs[0] == runs[1]).all() and (runs[0][1:] != runs[0][:-1]).any(axis=1).all()
    assert (env.reset(seed=4)[0] != runs[0][0]).any()


def test_amplitude_and_phase_of_the_deck_are_seen():
    env, layout = FootbridgeEnv(4), DeckLayout()
    env.reset(seed=0)
    x, v = 0.009, -0.012 * DECK.frequency  # 15 mm
    env.bridge._state = np.array(x), np.array(v), env.bridge._state[2]
    seen = env._observe(True)
    assert seen[layout["amplitude"]] == pytest.approx(0.5) and seen[layout["phase"]] == pytest.approx([0.6, -0.8])
    assert seen.shape == env.observation_space.shape == (layout.size,)


def test_a_closed_gate_lets_nobody_on_and_those_on_the_deck_walk_off():
    env, on_deck = FootbridgeEnv(60, coupling="off", interval=5.0), []
    for action in (0, 1):
        env.reset(seed=1)
        seen = [env.step(action)[0] for _ in range(14)][-1]
        on_deck.append((float(seen[env.layout["people"]][0]), float(seen[env.layout["queue"]][0])))
    (shut, waiting), (open_, queue) = on_deck
    assert shut < 0.1 < 0.3 < open_ and waiting > 0.3 and queue == 0.0


def test_what_crosses_pays_and_what_shakes_costs():
    env = FootbridgeEnv(60, coupling=Synchrony(force=600.0), interval=10.0, weight=0.1)  # each as if twenty
    env.reset(seed=0)
    discomfort, across = [], 0.0
    for _ in range(6):
        _, reward, _, _, info = env.step(1)
        assert reward == pytest.approx(info["reward/throughput"] + 0.1 * info["reward/discomfort"])
        discomfort.append(-info["reward/discomfort"])
        across += info["reward/throughput"]
    speed, length = env.bridge.simulation.bodies.desired_speed, DECK.length + 60.0
    assert across == pytest.approx(60.0 * (speed / length).sum(), rel=0.25)
    assert discomfort[0] < discomfort[-1] and env.bridge.amplitude > 0.02
    low, high = COMFORT
    worst = (env.bridge.amplitude * DECK.frequency**2 - low) / (high - low)
    assert env._discomfort(np.array([0.0, 1.0])) == pytest.approx([0.0, worst])


@pytest.mark.parametrize("interval", [0.1, 0.5, 2.0])
def test_discomfort_is_the_time_on_the_deck_times_the_scaled_acceleration(interval):
    """One at mid-span, of a deck that sways by an amplitude halfway between comfortable and intolerable."""
    env = FootbridgeEnv(1, coupling="off", interval=interval)
    env.reset(seed=0)
    env.bridge.simulation.state.position[:] = 0.5 * DECK.length, 2.0
    env.bridge._state = np.array(np.mean(COMFORT) / DECK.frequency**2), np.array(0.0), env.bridge._state[2]
    _, reward, _, _, info = env.step(1)
    assert info["reward/discomfort"] == pytest.approx(-0.5 * interval, rel=0.02)
    assert reward == pytest.approx(-0.02 * 0.5 * interval, rel=0.02)


def test_mistakes_are_said():
    with pytest.raises(ValueError, match="people"):
        FootbridgeEnv(0)
    with pytest.raises(ValueError, match="interval"):
        FootbridgeEnv(9, interval=0.25)
    with pytest.raises(ValueError, match="unknown coupling"):
        FootbridgeEnv(9, coupling="glue").reset(seed=0)
    env = FootbridgeEnv(9)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="the action"):
        env.step(2)


@pytest.mark.parametrize("coupling", ["synchrony", "pendulum"])
def test_a_checkpoint_takes_crowd_and_deck_back(coupling):
    env = FootbridgeEnv(20, coupling=coupling)
    env.reset(seed=0)
    bridge = env.bridge
    for _ in range(5):
        bridge.advance()
    kept = pickle.loads(pickle.dumps(bridge.checkpoint()))
    runs = []
    for _ in range(2):
        for _ in range(5):
            bridge.advance()
        runs.append((bridge.displacement, bridge.walkers_phase.copy(), bridge.simulation.state.position.copy()))
        bridge.restore(kept)
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one, other)
    bridge.simulation.restore(kept.behind)
    with pytest.raises(ValueError, match=r"^the Simulation alone was restored, the Footbridge was not"):
        bridge.advance()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: FootbridgeEnv(4, coupling={"force": 3}), "coupling is .*must be None, a Synchrony"),
        (lambda: FootbridgeEnv(4, coupling=5), "coupling is 5"),
        (lambda: FootbridgeEnv(4, coupling="glue"), "unknown coupling 'glue'"),
        (lambda: FootbridgeEnv(4).step(1), "call reset before the first step"),
        (lambda: _bridge().advance(n_substeps=0), "n_substeps is 0"),
        (lambda: _bridge(deck=Deck(stiffness=1e12)), "its frequency is .*at most"),
        (lambda: _bridge(deck=Deck(damping=1e12)), "its damping over mass is"),
    ],
)
def test_what_no_bridge_can_do_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.parametrize(
    "coupling", [Synchrony(force=1e9), Synchrony(sensitivity=1e300), Pendulum(height=1e-9), Pendulum(mass=1e12)]
)
def test_a_deck_that_nothing_holds_ends_in_a_sentence(coupling):
    with np.errstate(all="ignore"), pytest.raises(FloatingPointError, match=r"^the motion of the deck is not finite"):
        env = FootbridgeEnv(20, coupling=coupling)
        env.reset(seed=0)
        for _ in range(20):
            observation, reward, *_ = env.step(1)
            assert np.isfinite([*observation, reward]).all()


def _bridge(**options):
    env = FootbridgeEnv(4)
    env.reset(seed=0)
    return Footbridge(env.bridge.simulation, **options)
