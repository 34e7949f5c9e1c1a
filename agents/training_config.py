"""The parameters of a training run: made, checked, and read again when the run is continued."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from crowd_env import CrowdEnv, ObservationLayout, Scenario
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import POSITIVE, Range, known, number, whole
from crowd_env.core.files.json_file import read_json
from crowd_env.core.files.own import own_or_name
from crowd_env.core.libraries import needed_for
from crowd_env.envs.routing.batch import routing_arguments
from crowd_env.envs.routing.env import RoutingVectorEnv
from crowd_env.envs.settings import arguments_of, physics_step
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import Physics

from . import POLICIES, make_policy
from .evaluation.entries import RULE
from .evaluation.evaluation import HELD_OUT_SEED, VALIDATION_SEED
from .mixed import MixedEnv
from .runs import versions
from .tasks import Task, make_preset, make_task
from .tasks.presets import ALL_PLACES, GENERALIST, training_place
from .walking import Evolved, WalkingRule

# People simulated side by side in training: a rollout of more takes many gigabytes.
MOST_PEOPLE = 200_000
GENERATED, GENERATED_PLACES = "generated", "generated-v0"  # what is trained in all places, and their scenario
NOTHING = "nothing"  # training begins with a search that begins at full speed
MINUTES = 15.0  # after which a training on a task stops on a machine that is too slow for its steps
# PPO of a controller, where it departs from that of a policy: decisions are rare, and one a crowd.
ROUTING_PPO: dict[str, Any] = {"learning_rate": 1e-3, "n_steps": 32, "batch_size": 256}
ROUTING_PPO |= {"n_epochs": 8, "gamma": 0.99, "target_kl": 0.03}
ROUTING_BUDGET: dict[str, Any] = {"envs": 32, "steps": 120_000, "minutes": 10.0}
_PHYSICS = ("dt", "decision_dt", "strategy", "manner", "outline")
_MOST_CELLS = 10_000  # of a grid: nobody decides about more, and their names alone fill memory
LEAST_DT = Range(1e-5)  # s  a decision of 0.1 s is ten thousand steps of these
RUNS = Range(1, HELD_OUT_SEED - 1)  # held-out draws of an evaluation
SEEDS = Range(0, HELD_OUT_SEED - 1).because("larger ones are kept for evaluation")


def default_config(
    scenario: str,
    scheme: str,
    seed: int,
    envs: int,
    steps: int,
    minutes: float,
    dt: float | None = None,
    manner: str | None = None,
    outline: str | None = None,
    people: int | None = None,
    options: Mapping[str, Any] | None = None,
    routing: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return every parameter of a run in a scenario that is no task.

    Unless given, ``dt`` [s] is the scheme's own, manner, outline and number of people are the scenario's; ``options`` are those
    of `make_scenario`.  With ``routing``, options of `RoutingVectorEnv`, a controller is trained that sends people to exits.
    """
    from .learned import PPOSettings

    options = dict(options or {})
    place = training_place(scenario, options, people)
    return {
        "backend": "native",
        "task": None,
        "scenario": scenario,
        "options": options,
        "people": place.population.people,
        "routing": None if routing is None else dict(routing),
        "places": None,
        "strategy": place.strategy_of_run() if routing is None else "fastest",
        "scheme": scheme,
        "seed": seed,
        "envs": envs,
        "steps": steps,
        "minutes": minutes,
        "dt": physics_step(Physics(law_of({"scheme": scheme}), outline=outline), place) if dt is None else dt,
        "decision_dt": DECISION_DT,
        "manner": Headway.plain_of(place.behavior(Headway, manner)),
        "outline": Outline.plain_of(place.behavior(Outline, outline)),
        "frame": "path",
        "action": "continuous",
        "observation": ObservationLayout().as_table(),
        "reward": {"weights": {"progress": 0.5, "time": 1.0}, "team_share": 0.5},
        "start": RULE,
        "ppo": asdict(PPOSettings(**({} if routing is None else ROUTING_PPO))),
        "eval_every": 1_500_000 if routing is None else 8192,
        "eval_runs": 500 if routing is None else 50,
        "validation_seed": VALIDATION_SEED,
        "held_out_seed": HELD_OUT_SEED,
        "versions": versions(),
    }


def task_config(task: str, seed: int = 0, **given: Any) -> dict[str, Any]:
    """Return every parameter of a run on a task: those of its preset, but for what is ``given``.

    Parameters
    ----------
    given : any of ``people``, ``scheme``, ``dt`` [s], ``manner``, ``outline``, ``start``, ``envs``, ``steps``, ``minutes``,
        ``routing``; None = as the preset has it.  With ``routing`` there is no preset: it is trained in the task as it stands.

    Raises
    ------
    ValueError
        If the task is unknown or has no preset.
    """
    from .learned import PPOSettings

    given = {name: value for name, value in given.items() if value is not None}
    judged, preset = make_task(task), None if "routing" in given else make_preset(task)
    begun = preset or judged
    usual: dict[str, Any] = {"scheme": judged.scheme, "people": begun.people, "manner": judged.manner}
    if given.get("scheme", judged.scheme) == judged.scheme:
        usual["dt"] = begun.dt
    usual |= {"envs": preset.envs, "steps": preset.steps, "minutes": MINUTES} if preset else ROUTING_BUDGET
    start = given.pop("start", preset.start if preset else RULE)
    options = {**judged.options, **(preset.options if preset else {})}
    config = default_config(judged.scenario, seed=seed, options=options, **(usual | given))
    config |= {"task": task, "strategy": judged.rule, "decision_dt": judged.decision_dt, "start": start}
    if preset:
        config |= {
            "action": preset.action,
            "observation": ObservationLayout(terms=preset.terms).as_table(),
            "reward": dict(preset.reward),
            "ppo": asdict(PPOSettings(**preset.settings(start))),
            "eval_every": preset.eval_every,
            "eval_runs": preset.eval_runs,
        }
    return config


def generalist_config(seed: int = 0, **given: Any) -> dict[str, Any]:
    """Return every parameter of a training in all places: those of the preset "generated", but for what is ``given``.

    Parameters
    ----------
    given : any of ``people``, of the largest places, ``envs``, ``steps`` and ``minutes`` of PPO; None = as the preset has it.
    """
    from .learned import PPOSettings

    given = {name: value for name, value in given.items() if value is not None}
    preset = GENERALIST
    budget = {name: given.get(name, preset[name]) for name in ("envs", "steps", "minutes")}
    config = default_config(GENERATED_PLACES, "nsm2", seed, **budget)
    return config | {
        "places": {**preset["places"], **({"people": given["people"]} if "people" in given else {})},
        "action": preset["action"],
        "observation": ObservationLayout(terms=tuple(preset["terms"])).as_table(),
        "reward": preset["reward"],
        "start": NOTHING,
        "ppo": asdict(PPOSettings(**preset["ppo"])),
        "eval_every": preset["eval_every"],
        "eval_runs": preset["eval_runs"],
    }


def place_of(config: Mapping[str, Any]) -> Scenario:
    """Return the scenario that is trained in."""
    return training_place(config["scenario"], config["options"], config["people"])


def task_of(config: Mapping[str, Any]) -> Task:
    """Return what a run is judged on: its task, or the scenario, steps and scheme that it was trained in."""
    if config["task"] is not None:
        return make_task(config["task"])
    place = place_of(config)
    return Task(
        place.name,
        place.title,
        scheme=law_of(config).info.name,
        time_limit=place.time_limit,
        blocked_after=place.blocked_after,
        frozen="",
        rule=config["strategy"],
        **{name: config[name] for name in ("scenario", "options", "people", "dt", "decision_dt")},
    )


def law_of(config: Mapping[str, Any]) -> ContactScheme:
    """Return the contact scheme that a run is trained and judged under, which may be the user's own."""
    return make_scheme(own_or_name("--scheme", config["scheme"]))


def start_of(config: Mapping[str, Any]) -> WalkingRule:
    """Return the rule that a run begins by cloning.

    Raises
    ------
    ValueError
        If it is no rule of walking.
    """
    names = [name for name, kind in POLICIES.items() if issubclass(kind, WalkingRule)]
    return cast(WalkingRule, make_policy(known("start", config["start"], [RULE, NOTHING, *names])))


def judged_place(config: Mapping[str, Any]) -> Scenario:
    """Return the scenario that a run is judged in: of a task with all its people, else what is trained in."""
    place = place_of(config) if config["task"] is None else make_task(config["task"]).place()
    return replace(place, manner=config["manner"], outline=config["outline"])


def physics_of(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of `evaluate` under which a run is validated: those it was trained with."""
    return {"scheme": law_of(config)} | {name: config[name] for name in _PHYSICS}


def facts_of(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the file of a network says of its training."""
    facts = (
        "scenario",
        "options",
        "people",
        "scheme",
        "dt",
        "decision_dt",
        "manner",
        "outline",
        "start",
        "seed",
        "versions",
    )
    task = None if config["task"] is None else task_of(config).identity()
    task = task if config["places"] is None else dict(ALL_PLACES)
    return {"task": task, **{name: config[name] for name in facts}}


def make_env(config: Mapping[str, Any], envs: int | None = None, threads: int = 1) -> Any:
    """Return the training batch, of ``envs`` rooms if that is given, on so many threads.

    It is a `CrowdEnv`, or a `RoutingVectorEnv` where a controller is trained.
    """
    num_envs = config["envs"] if envs is None else envs
    if config["places"] is not None:
        from .learned.generalist import make_crowds

        return make_crowds(config, num_envs)
    if config["routing"] is not None:
        physics = {name: config[name] for name in ("dt", "manner", "outline")}
        options = {"scheme": law_of(config), "threads": threads, **physics, **config["routing"]}
        arguments = routing_arguments(place_of(config), **options)
        return RoutingVectorEnv(num_envs=num_envs, **arguments)
    learned = {name: config[name] for name in ("frame", "action", "observation", "reward")}
    arguments = arguments_of({"threads": threads, **physics_of(config), **learned})
    share = task_of(config).learned_share
    arguments |= {"num_envs": num_envs, "autoreset": True}
    return (
        CrowdEnv(place_of(config), **arguments)
        if share is None
        else MixedEnv(place_of(config), share=share, **arguments)
    )


def check_libraries() -> None:
    """Raise ModuleNotFoundError now, not after the training, if a library is missing; say how to install it."""
    with needed_for("training", "stable-baselines3 tensorboard torch"):
        import_module(f"{__package__}.learned")


def check_budget(**options: float) -> None:
    """Raise ValueError unless all of these are > 0 and finite."""
    for name, value in options.items():
        number(f"--{name}", value, POSITIVE)


def check_config(config: Mapping[str, Any]) -> None:
    """Raise ValueError if nothing can be trained with these parameters; one room is made to see."""
    from .learned import PPOSettings

    PPOSettings(**config["ppo"])
    whole("seed", config["seed"], SEEDS)
    check_budget(minutes=config["minutes"], steps=config["steps"], envs=config["envs"])
    number("--set dt", config["dt"], LEAST_DT, "s")
    people = place_of(config).population.people
    if config["envs"] * people > MOST_PEOPLE:
        raise ValueError(
            f"--envs is {config['envs']}: with {people} people each that is {config['envs'] * people} at once; "
            f"at most {MOST_PEOPLE} are trained side by side, here --envs {max(MOST_PEOPLE // people, 1)}"
        )
    columns, rows = (config["routing"] or {}).get("grid", (1, 1))
    if columns * rows > _MOST_CELLS:
        raise ValueError(f"--set grid is {columns} {rows}; it must have at most {_MOST_CELLS} cells")
    if config["routing"] is not None and config["start"] != RULE:
        raise ValueError(f"--start is {config['start']}: a controller begins at the nearest exits; leave it out")
    env = make_env(config, envs=1)
    if config["start"] != RULE:
        rule = Evolved() if config["start"] == NOTHING else start_of(config)
        rule.act(np.zeros((env.num_people, env.layout.size), dtype=np.float32), env.layout, np.random.default_rng(0))


def read_config(path: Path) -> dict[str, Any]:
    """Read the parameters of a run.

    Raises
    ------
    ValueError
        If the file is missing, or lacks or holds something that a run cannot have.
    """
    config = read_json(path)
    if not isinstance(config, dict):
        raise ValueError(f"{path} does not hold the parameters of a run")
    expected = default_config("room-v0", "nsm2", 0, 1, 1, 1.0)
    missing = [name for name in expected if name not in config]
    if missing:
        raise ValueError(f"{path} lacks {missing[0]!r}: it was not written by this version of train.py")
    try:
        check_config(config)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise ValueError(f"{path} cannot be gone on with: {error}") from None
    return config


def extended(
    config: Mapping[str, Any], given: Mapping[str, Any], curve: list[dict[str, float]], name: str
) -> dict[str, Any]:
    """Return the parameters of a run that is continued under options from the command line.

    Parameters
    ----------
    config : of the run.
    given : options that were given beside ``--resume``: ``minutes`` and ``steps`` replace the budget, in all; the others may
        only repeat what the run was begun with.
    curve : of the run so far.
    name : of the run.

    Raises
    ------
    ValueError
        If an option would change what is trained, or a budget leaves nothing to do.
    """
    found = dict(config)
    routing = config["routing"] or {}
    begun = {**config, **routing, "exit": config["options"].get("exits"), "unit": config["options"].get("unit")}
    begun |= {"place": config["task"] or config["scenario"], "decides": "routing" if routing else "walking"}
    said = {"manner": "walking", "place": "task"} | {one: f"set {one}" for one in ("dt", "outline")}
    for option, value in given.items():
        if option in ("minutes", "steps"):
            found[option] = value
        elif value != begun.get(option):
            raise ValueError(
                f"--{said.get(option, option)} is {value}, but {name} was begun with {begun.get(option)}: "
                "what is trained cannot change in between; begin another run"
            )
    if not curve or not {"minutes", "steps"} & set(given):
        return found
    for option, spent in (("minutes", curve[-1]["seconds"] / 60.0), ("steps", curve[-1]["steps"])):
        if found[option] <= spent:
            raise ValueError(
                f"{name} has trained for {spent:.6g} {option} by now, and --{option} is {found[option]:g} in all: "
                f"nothing is left to do; give more --{option}"
            )
    return found
