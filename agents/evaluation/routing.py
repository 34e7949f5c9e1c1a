"""Controllers that send people to exits, evaluated on the same draws as people who choose their way themselves."""

from collections.abc import Callable
from typing import Any

from crowd_env import Scenario
from crowd_env.core.arrays.headway import plain_manner
from crowd_env.core.arrays.outline import plain_outline
from crowd_env.envs.rollout import Driver
from crowd_env.envs.routing.batch import RoutingBatch, routing_arguments

from ..controllers import Controller
from ..drivers import ControllerDriver, policy_driver, sample_step
from ..rules import StrategyPolicy
from .evaluation import Evaluation, evaluate_driver

# What people do without a controller, by the strategy of `CrowdEnv`.
STRATEGIES = {"nearest exit": "nearest", "shortest path": "shortest", "fastest path": "fastest"}


def evaluate_controller(
    controller: Controller | str,
    scenario: str | Scenario,
    *,
    runs: int,
    first_seed: int,
    progress: Callable[[int], None] | None = None,
    **options: Any,
) -> Evaluation:
    """Run the draws ``first_seed`` ... ``first_seed + runs - 1`` under a controller or a name in ``STRATEGIES``.

    Parameters
    ----------
    progress : called with the number of evacuations that have just ended.
    options : of `crowd_env.envs.routing.env.RoutingEnv`.

    Raises
    ------
    ValueError
        If an option is unknown, out of range, or does not fit the others.
    """
    one = RoutingBatch(**routing_arguments(scenario, **options))
    simulation, sample_dt = one.env.simulation, sample_step(one.interval, one.env.simulation.dt)
    driver: Callable[[int], Driver]
    if isinstance(controller, str):
        name = controller
        driver = policy_driver(
            StrategyPolicy(STRATEGIES[controller], rules=bool(options.get("rules", False))),
            one.scenario,
            scheme=simulation.scheme,
            dt=simulation.dt,
            decision_dt=sample_dt,
            threads=simulation.threads,
            manner=plain_manner(simulation.manner),
            outline=plain_outline(simulation.outline),
            time_limit=float(one.env.time_limit[0]),
        )
    else:
        name = controller.name

        def of_controller(num_envs: int) -> Driver:
            return ControllerDriver(controller, scenario, num_envs=num_envs, sample_dt=sample_dt, **options)

        driver = of_controller

    return evaluate_driver(
        driver, one.scenario, name, simulation.scheme, runs=runs, first_seed=first_seed, progress=progress
    )
