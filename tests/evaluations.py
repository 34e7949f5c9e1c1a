"""Small evaluations that several test files share."""

from dataclasses import replace

import numpy as np
from typer.testing import CliRunner

from crowd_env import (
    FULL_SPEED,
    TABLE_4,
    ControlRule,
    CrowdEnv,
    Geometry,
    ObservationLayout,
    Population,
    Scenario,
    Uniform,
)
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate_crowd
from crowd_env.agents.networks import MLP
from crowd_env.agents.trained import LearnedPolicy
from crowd_env.analysis.results.measurements import MeasurementRecorder
from crowd_env.cli.agents import evaluate as command
from crowd_env.geometry.geometry import box

NAMES = ("shortest", "nearest", "fastest", "west", "rules", "random", "stand-still")


def hall(count=14, time_limit=25.0, *, starts=None, speed=None, **more):
    """10 x 6 m, a narrow exit in the west, a wide one in the east; everyone starts in the left half."""
    exits = {"west": [(0, 2.5), (0, 3.5)], "east": [(10, 2), (10, 4)]}
    regions = {"left": box(0, 0, 5, 6), "west door": box(0, 1.5, 2, 4.5)}
    geometry = Geometry.from_polygon(box(0, 0, 10, 6), exits=exits, regions=regions)
    people = {"start_region": "left"} if starts is None else {"starts": np.array(starts, dtype=np.float64)}
    if speed is not None:
        people["desired_speed"] = Uniform(speed, speed)
    number = count if starts is None else len(starts)
    population = Population(number, **{**TABLE_4, "radius": Uniform(0.2, 0.2), **people})
    return Scenario("hall", geometry, population, time_limit, **{**FULL_SPEED, **more})


SMALL = hall()
RULED = hall(rules=(ControlRule("west door", at_least=3, route="east"),))


def run(name, scenario=SMALL, scheme="nsm2", runs=3, **options):
    (entry,) = make_entries([name], scenario)
    return evaluate_crowd(entry.driver(scenario, physics=scheme), **{"runs": runs, "measure": True, **options})


def recorded(scenario, steps=0, scheme="nsm2"):
    """Return environment and recorder of one evacuation after so many steps."""
    env, recorder = CrowdEnv(scenario, physics=scheme), MeasurementRecorder(scenario.geometry)
    env.reset([0])
    recorder.begin(env, [0])
    for _ in range(steps):
        recorder.add(env, env.step(None))
    return env, recorder


def made_up(policy, scheme, last, *, unfinished=False):
    """Return an evaluation of runs of two people, of whom the second gets out at ``last``; nan, or unfinished: never."""
    times = [np.array([1.0, np.nan if unfinished else time]) for time in last]
    result = run("stand-still", hall(time_limit=0.2), runs=len(last), measure=False)
    episodes = [
        episode._replace(unfinished=int(np.isnan(time[1])), evacuation_time=time[1])
        for episode, time in zip(result.episodes, times, strict=True)
    ]
    ended = np.full(len(last), 100.0)
    changes = {"policy": policy, "scheme": scheme, "episodes": episodes, "exit_times": times, "ended": ended}
    return replace(result, **changes, time_limit=100.0)


def random_network(inputs, outputs, seed=0, hidden=8):
    """Return an untrained network."""
    rng, sizes = np.random.default_rng(seed), (inputs, hidden, hidden, outputs)
    weights = [rng.normal(0.0, 0.3, shape) for shape in zip(sizes[1:], sizes[:-1], strict=True)]
    return MLP(tuple(weights), tuple(np.zeros(size) for size in sizes[1:]))


def random_policy(seed=0, **options):
    """Return an untrained policy; ``options`` are frame, action and observation."""
    options = {"frame": "path", "action": "continuous", "observation": ObservationLayout(), **options}
    outputs = 2 if options["action"] == "continuous" else 9
    return LearnedPolicy(random_network(options["observation"].size, outputs, seed), options)


def call(*arguments):
    """Return exit code, standard output and standard error of ``crowd-env evaluate``."""
    result = CliRunner().invoke(command.app, [str(argument) for argument in arguments])
    return result.exit_code, result.stdout, result.stderr
