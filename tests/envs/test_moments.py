"""Checkpoints behind every interface: back in a moment, the same actions lead bit by bit to the same."""

import pickle

import gymnasium
import numpy as np
import pytest
from late import late

from crowd_env import CrowdEnv, GeneratedCrowds, make_scenario, make_vec, parallel_env
from crowd_env.envs.parallel import env as aec_env
from crowd_env.scenarios.generated import Conditions

CrowdVecEnv, VectorVecEnv = late("crowd_env.envs.adapters.sb3", "CrowdVecEnv", "VectorVecEnv")
MixedEnv = late("crowd_env.agents.mixed", "MixedEnv")

CROWD = {"people": 6, "physics": "dem", "time_limit": 4.0}
ACTIONS = np.random.default_rng(0).uniform((0.2, -0.5), (1.0, 0.5), (60, 12, 2))


def crowd(**options):
    return CrowdEnv("room-v0", num_envs=2, autoreset=True, **{**CROWD, **options})


def rooms(mode, **options):
    return make_vec("room-v0", 2, autoreset_mode=mode, **{**CROWD, **options})


def controller(**options):
    return gymnasium.make("crowd_env/routing-v0", people=8, physics="dem", time_limit=30.0, **options).unwrapped


def controllers(**options):
    return gymnasium.make_vec("crowd_env/routing-v0", 2, people=8, physics="dem", time_limit=30.0, **options)


def places(**options):
    """Two places that take turns, most of them a room in which a turn takes 0.8 s; what is seen there is disturbed."""
    room = make_scenario("room-v0", people=6, time_limit=0.8)
    beside = [(room, Conditions("dem", "competitive", 0.05))]
    return GeneratedCrowds(2, **{"people": 12, "seeds": 300, "beside": beside, "share": 0.8, **options})


MADE = {  # each by its options; every one of two rooms of 6 people, or of one
    "arrays": crowd,
    "mixed": lambda **options: MixedEnv("room-v0", num_envs=2, share=0.5, autoreset=True, **{**CROWD, **options}),
    "parallel": lambda **options: parallel_env("room-v0", **{**CROWD, **options}),
    "aec": lambda **options: aec_env("room-v0", **{**CROWD, **options}),
    "gymnasium": lambda **options: gymnasium.make("crowd_env/room-v0", **{**CROWD, **options}).unwrapped,
    "SameStep": lambda **options: rooms("SameStep", **options),
    "NextStep": lambda **options: rooms("NextStep", **options),
    "Disabled": lambda **options: rooms("Disabled", **options),
    "routing": controller,
    "routings": controllers,
    "sb3": lambda **options: CrowdVecEnv(crowd(**options)),
    "sb3 of rooms": lambda **options: VectorVecEnv(rooms("SameStep", **options)),
    "generated": places,
    "sb3 of places": lambda **options: CrowdVecEnv(places(**options)),
    "footbridge": lambda **options: (
        gymnasium.make("crowd_env/footbridge-gate-v0", people=20, time_limit=9.0, **options).unwrapped
    ),
}
every_interface = pytest.mark.parametrize("name", MADE)


def reset(env, seed=None):
    if hasattr(env, "step_async"):
        if seed is not None:
            env.seed(seed)
        return env.reset()
    return env.reset(seed=seed)


def step(name, env, k):
    """Return all that a step tells; an environment that has ended is reset without a seed."""
    action = ACTIONS[k]
    if name == "parallel":
        seen = env.step({agent: action[int(agent[-1])] for agent in env.agents}), list(env.agents)
        return seen if env.agents else (seen, reset(env))
    if name == "aec":
        seen = []
        for _ in range(len(env.agents)):
            agent, (*last, terminated, truncated, _) = env.agent_selection, env.last()
            seen.append([agent, *last, terminated, truncated])
            env.step(None if terminated or truncated else action[int(agent[-1])])
        if not env.agents:
            env.reset()
        return seen
    if name in ("generated", "sb3 of places"):
        action = np.tile(action, (2, 1))[: getattr(env, "num_people", env.num_envs)]
    if name in ("arrays", "mixed", "generated", "sb3", "sb3 of places"):
        made = env.step(action)
        return made[:4] if name.startswith("sb3") else (*made[:4], made[4]["finished"])
    if name in ("gymnasium", "routing", "footbridge"):
        few = env.action_space.shape
        chosen = (
            action[:6] if name == "gymnasium" else (action[: few[0], 0] > 0.6).astype(int) if few else int(k % 4 != 1)
        )
        made = env.step(chosen)
        return (made[:4], reset(env)[0]) if made[2] or made[3] else made[:4]
    if name == "routings":
        return env.step((ACTIONS[k, : env.action_space.shape[1], 0] > 0.6).astype(int) * np.ones((2, 1), int))[:4]
    if name == "Disabled" and env._ended.any():
        env.reset(options={"reset_mask": env._ended.copy()})
    return env.step(action.reshape(2, 6, 2))[:4]


def same(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    return np.array_equal(one, other) or (one != one and other != other)


@every_interface
def test_the_same_actions_lead_bit_by_bit_to_the_same(name):
    """Some have left at step 30; episodes end at step 40, the last of those from 15 on, and are reset without a seed."""
    env, moments, told = MADE[name](), {}, []
    reset(env, 3)
    for k in range(50):
        if k in (15, 30):
            moments[k] = pickle.loads(pickle.dumps(env.checkpoint()))
        told.append(step(name, env, k))
    env.restore(moments[15])
    assert same([step(name, env, k) for k in range(15, 45)], told[15:45])
    other = MADE[name]()
    other.restore(moments[30])
    assert same([step(name, other, k) for k in range(30, 50)], told[30:])


@every_interface
def test_an_interface_does_not_go_on_when_what_is_behind_it_was_restored_alone(name):
    env = MADE[name]()
    reset(env, 3)
    behind = getattr(env.unwrapped if name == "aec" else env, env._behind)
    then, whole = behind.checkpoint(), env.checkpoint()
    step(name, env, 0)
    behind.restore(then)
    with pytest.raises(ValueError, match=r"^the \w+ alone was restored, the \w+ was not; restore or reset that$"):
        step(name, env, 1)
    with pytest.raises(ValueError, match="alone was restored"):
        env.checkpoint()
    env.restore(whole)
    step(name, env, 0)
    behind.restore(then)
    reset(env, 3)
    step(name, env, 0)


def test_places_do_not_go_on_when_one_of_them_was_restored_alone():
    env = places()
    env.reset(seed=3)
    crowd = env._turns[1].crowd
    crowd.restore(crowd.checkpoint())
    with pytest.raises(ValueError, match=r"^the CrowdEnv alone was restored, the GeneratedCrowds was not"):
        env.step(None)


OTHER = {"reward": {"time": 2.0}}
REFUSED = {name: [OTHER, {"walking": {"manner": "calm", "acts_on": "scripted"}}] for name in MADE} | {
    "mixed": [OTHER],
    "routing": [{"reward": {"mean": 2.0}}, {"interval": 1.0}],
    "routings": [{"reward": {"mean": 2.0}}],
    "generated": [OTHER, {"people": 10}, {"share": 0.4}, {"beside": ()}, {"observation": {"terms": ["velocity"]}}],
    "sb3 of places": [{"routing": "nearest"}],
    "footbridge": [{"weight": 1.0}, {"coupling": "pendulum"}],
}


@every_interface
def test_a_checkpoint_of_other_rewards_or_people_is_refused(name):
    for options in REFUSED[name]:
        env, other = MADE[name](), MADE[name](**options)
        for one in (env, other):
            reset(one, 3)
        with pytest.raises(ValueError, match=r"^the checkpoint fits another (environment|simulation): its "):
            env.restore(other.checkpoint())


def test_a_checkpoint_of_another_interface_is_refused():
    env, other = MADE["SameStep"](), MADE["NextStep"]()
    env.reset(seed=0)
    other.reset(seed=0)
    with pytest.raises(ValueError, match=r"its autoreset_mode differs: 'NextStep', here 'SameStep'$"):
        env.restore(other.checkpoint())
    with pytest.raises(ValueError, match=r"its class differs: 'CrowdEnv', here 'CrowdVectorEnv'$"):
        env.restore(env.env.checkpoint())
    with pytest.raises(TypeError, match=r"^restore takes a checkpoint\(\) of an environment, not dict$"):
        env.restore({})


def test_whoever_was_inside_is_an_agent_again():
    env = parallel_env({"name": "room-v0", "side": 20.0}, people=8, physics="dem")
    env.reset(seed=1)
    for _ in range(20):
        env.step({})
    moment, names = env.checkpoint(), list(env.agents)
    while len(env.agents) > 4:
        env.step({})
    env.restore(moment)
    assert env.agents == names
    told = env.step({name: [0.0, 0.0] for name in names})
    assert all(list(part) == names for part in told)
