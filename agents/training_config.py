"""The parameters of a training run: how they are made, checked, and read when the run is resumed."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np

from crowd_env import CrowdEnv, GeneratedCrowds, ObservationLayout, Scenario
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import (
    POSITIVE,
    Natural,
    NotNegative,
    Positive,
    Range,
    Share,
    check_fields,
    known,
    number,
)  # fmt: skip
from crowd_env.core.files.json_file import read_json
from crowd_env.core.files.own import own_or_name
from crowd_env.core.libraries import needed_for
from crowd_env.envs.protocol import WalkingBatch
from crowd_env.envs.routing.batch import routing_arguments
from crowd_env.envs.routing.env import RoutingVectorEnv
from crowd_env.envs.settings import arguments_of, physics_step
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import Physics
from crowd_env.scenarios.generated import Conditions

from . import POLICIES, make_policy
from .evaluation.entries import RULE
from .evaluation.evaluation import VALIDATION_SEED
from .mixed import MixedEnv
from .plain import Plain
from .runs import commit, versions
from .tasks import TASKS, Task, make_preset, make_task
from .tasks.presets import ALL_PLACES, GENERALIST, PRESETS, training_place
from .walking import Evolved, WalkingRule

# Pedestrians simulated side by side in training: a rollout of more takes many gigabytes.
MOST_PEOPLE = 200_000
GENERATED, GENERATED_PLACES = "generated", "generated-v0"  # name of a training in all places, and of their scenario
NOTHING = "nothing"  # training begins with a search that starts at full speed
MINUTES = 15.0  # limit of a training on a task, for a machine that is too slow for its steps
ROUTING_BUDGET: Mapping[str, float] = {"envs": 32, "steps": 120_000, "minutes": 10.0}
_MOST_CELLS = 10_000  # of a grid: the names of more cells fill memory
_LONGEST = 150.0  # s  limit of a run in the place of a task, in a training in all places
LEAST_DT = Range(1e-5)  # s  a decision of 0.1 s is ten thousand steps of these
RUNS = Range(1, HELD_OUT_SEED - 1)  # held-out draws of an evaluation
SEEDS = Range(0, HELD_OUT_SEED - 1).because("larger ones are kept for evaluation")


@dataclass(frozen=True)
class PPOSettings:
    """Hyperparameters of PPO; the defaults are tuned for room-v0.

    Parameters
    ----------
    learning_rate : falls linearly to zero over the steps, or over the second half of the time.
    n_steps : decision steps of a rollout.
    batch_size : samples of a minibatch, of pedestrians inside.
    n_epochs : passes over a rollout.
    gamma : discount of a decision step.
    gae_lambda : of generalized advantage estimation.
    clip_range : largest change of a probability ratio in the objective.
    ent_coef : weight of the entropy.
    hidden : units in each of two layers.
    distribution : of continuous actions; "beta" is bounded.
    log_std_init : logarithm of the standard deviation of a Gaussian at first.
    rule_logit : logit of the rule at first, above the logits of the other choices.
    target_kl : KL divergence from the old policy at which an update stops.
    """

    learning_rate: NotNegative = 7e-4
    n_steps: int = 128
    batch_size: int = 16384
    n_epochs: int = 6
    gamma: Share = 0.97
    gae_lambda: Share = 0.95
    clip_range: Positive = 0.2
    ent_coef: NotNegative = 0.003
    hidden: int = 64
    distribution: Literal["gaussian", "beta"] = "gaussian"
    log_std_init: float = -0.7
    rule_logit: float = 2.0
    target_kl: Positive = 0.05

    def __post_init__(self) -> None:
        check_fields("", self)


# PPO of a controller: decisions are rare, and one a crowd.
ROUTING_PPO = PPOSettings(learning_rate=1e-3, n_steps=32, batch_size=256, n_epochs=8, gamma=0.99, target_kl=0.03)


@dataclass(frozen=True)
class GeneratedPlaces:
    """The places of a training in all places.

    Parameters
    ----------
    people : pedestrians of the largest places.
    seeds : number of generated places that episodes are drawn from.
    taught : number of generated places with an expert policy.
    share : share of the episodes in places of tasks.
    rounds : of DAgger, which clones the expert policies.
    """

    people: int
    seeds: int
    taught: int
    share: Share
    rounds: int

    def __post_init__(self) -> None:
        check_fields("places", self)


@dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """Every parameter of a training run; ``config.json`` of a run holds the same names.

    Parameters
    ----------
    backend : library that trains.
    task : name of the task; None = a scenario without a task.
    scenario : name or file of the place.
    options : of the scenario.
    people : pedestrians of an environment.
    routing : options of `RoutingVectorEnv`, for a controller; None = a policy of each pedestrian's steps.
    places : generated places; None = one place.
    strategy : routing strategy.
    scheme : contact scheme.
    seed : of draws and networks.
    envs : environments side by side.
    steps : budget, summed over all pedestrian slots.
    minutes : budget [min].
    dt : physics step [s].
    decision_dt : decision step [s].
    manner : how pedestrians walk, by name or as a table.
    outline : shape of bodies, by name or as a table.
    frame : of actions.
    action : kind of action, by name or as a table.
    observation : table of an `ObservationLayout`.
    reward : table of `RewardWeights`.
    start : start of learning: "rule", "nothing", or the name of a policy of rules to clone.
    ppo : hyperparameters.
    eval_every : steps between two evaluations.
    eval_runs : validation draws of an evaluation.
    validation_seed : first validation draw.
    held_out_seed : first held-out draw.
    versions : of the libraries that can change a result, and the ``commit`` of a checkout.

    Raises
    ------
    ValueError
        If a field is of a wrong type or out of range.
    """

    backend: str = "native"
    task: str | None = None
    scenario: str
    options: Plain = field(default_factory=dict)
    people: int
    routing: Plain | None = None
    places: GeneratedPlaces | None = None
    strategy: str
    scheme: str
    seed: Annotated[int, SEEDS]
    envs: int
    steps: int
    minutes: Positive
    dt: Annotated[float, LEAST_DT]
    decision_dt: Positive = DECISION_DT
    manner: str | Plain
    outline: str | Plain
    frame: str = "path"
    action: str | Plain = "continuous"
    observation: Plain = field(default_factory=lambda: ObservationLayout().as_table())
    reward: Plain = field(default_factory=lambda: {"weights": {"progress": 0.5, "time": 1.0}, "team_share": 0.5})
    start: str = RULE
    ppo: PPOSettings = PPOSettings()
    eval_every: int = 1_500_000
    eval_runs: int = 500
    validation_seed: Natural = VALIDATION_SEED
    held_out_seed: Natural = HELD_OUT_SEED
    versions: Plain = field(default_factory=lambda: {**versions(), "commit": commit()})

    def __post_init__(self) -> None:
        check_fields("", self)

    def as_table(self) -> Plain:
        """Return plain data, as ``config.json`` holds it."""
        return asdict(self)


def default_config(
    scenario: str, scheme: str, seed: int, envs: int, steps: int, minutes: float, **given: Any
) -> TrainingConfig:
    """Return every parameter of a run: the ``given`` fields of `TrainingConfig`, and else those of the scenario.

    By default ``dt`` [s] is that of the scheme.  With ``routing``, options of `RoutingVectorEnv`, a controller learns to send
    pedestrians to exits.

    Raises
    ------
    ValueError
        If a parameter is unknown or out of range.
    """
    place = training_place(scenario, given.get("options", {}), given.get("people"))
    usual: dict[str, Any] = {"people": place.population.people, "strategy": place.strategy_of_run()}
    if given.get("routing") is not None:
        usual |= {"strategy": "fastest", "ppo": ROUTING_PPO, "eval_every": 8192, "eval_runs": 50}
    manner = Headway.plain_of(place.behavior(Headway, given.pop("manner", None)))
    outline = Outline.plain_of(place.behavior(Outline, given.pop("outline", None)))
    if "dt" not in given:
        usual["dt"] = physics_step(Physics(_scheme(scheme), outline=outline), place)
    return TrainingConfig(
        scenario=scenario,
        scheme=scheme,
        seed=seed,
        envs=envs,
        steps=steps,
        minutes=minutes,
        manner=manner,
        outline=outline,
        **(usual | given),
    )


def task_config(task: str, seed: int = 0, **given: Any) -> TrainingConfig:
    """Return every parameter of a run on a task: the ``given`` fields of `TrainingConfig`, and else those of its preset.

    Parameters
    ----------
    given : None = that of the preset.  A training with ``routing`` uses the task itself instead of a preset.

    Raises
    ------
    ValueError
        If the task is unknown or has no preset.
    """
    given = {name: value for name, value in given.items() if value is not None}
    judged, preset = make_task(task), None if "routing" in given else make_preset(task)
    usual = _of(judged, "scheme", "manner", "people", "dt", "decision_dt", "options")
    if preset is None:
        usual |= ROUTING_BUDGET
    else:
        usual |= _of(preset, "people", "dt", "envs", "steps", "start", "eval_every", "eval_runs")
        usual |= {"minutes": MINUTES, "options": {**judged.options, **preset.options}}
        usual |= {"action": judged.action, "reward": judged.reward, "observation": _observation(judged.terms)}
        usual |= {"ppo": preset.settings(given.get("start", preset.start))}
    if given.get("scheme", judged.scheme) != judged.scheme:
        del usual["dt"]  # the other scheme has a step of its own
    return default_config(judged.scenario, seed=seed, task=task, strategy=judged.rule, **(usual | given))


def generalist_config(seed: int = 0, **given: Any) -> TrainingConfig:
    """Return every parameter of a training in all places: ``given`` ones, and else those of the preset "generated".

    Parameters
    ----------
    given : any of ``people``, of the largest places, and ``envs``, ``steps`` and ``minutes`` of PPO.
    """
    preset = {**GENERALIST["places"], **GENERALIST, **given}
    names = ("envs", "steps", "minutes", "action", "reward", "ppo", "eval_every", "eval_runs")
    return default_config(
        GENERATED_PLACES,
        "nsm2",
        seed,
        start=NOTHING,
        places={one.name: preset[one.name] for one in fields(GeneratedPlaces)},
        observation=_observation(preset["terms"]),
        **{name: preset[name] for name in names},
    )


def _observation(terms: Sequence[str]) -> Plain:
    return ObservationLayout(terms=tuple(terms)).as_table()


def _of(thing: object, *names: str) -> dict[str, Any]:
    """Return attributes by their names."""
    return {name: getattr(thing, name) for name in names}


def place_of(config: TrainingConfig) -> Scenario:
    """Return the scenario of the training."""
    return training_place(config.scenario, config.options, config.people)


def task_of(config: TrainingConfig) -> Task:
    """Return the task that judges a run: its own, or one of the scenario, steps and scheme of the training."""
    if config.task is not None:
        return make_task(config.task)
    place = place_of(config)
    return Task(
        place.name,
        place.title,
        scheme=law_of(config).info.name,
        time_limit=place.time_limit,
        blocked_after=place.blocked_after,
        frozen="",
        rule=config.strategy,
        **_of(config, "scenario", "options", "people", "dt", "decision_dt"),
    )


def law_of(config: TrainingConfig) -> ContactScheme:
    """Return the contact scheme of training and evaluation, which may be defined in a file of the user."""
    return _scheme(config.scheme)


def _scheme(name: str) -> ContactScheme:
    return make_scheme(own_or_name("--scheme", name))


def start_of(config: TrainingConfig) -> WalkingRule:
    """Return the rule that a run clones first.

    Raises
    ------
    ValueError
        If the start is no rule of walking.
    """
    names = [name for name, kind in POLICIES.items() if issubclass(kind, WalkingRule)]
    return cast(WalkingRule, make_policy(known("start", config.start, [RULE, NOTHING, *names])))


def judged_place(config: TrainingConfig) -> Scenario:
    """Return the scenario of the evaluations: of a task with all its pedestrians, else that of the training."""
    place = place_of(config) if config.task is None else make_task(config.task).place()
    return replace(place, manner=config.manner, outline=config.outline)


def physics_of(config: TrainingConfig) -> Plain:
    """Return the options of the environments in training and validation."""
    return {"scheme": law_of(config), **_of(config, "dt", "decision_dt", "strategy", "manner", "outline")}


def facts_of(config: TrainingConfig) -> Plain:
    """Return the facts of the training in the file of a network."""
    task = None if config.task is None else task_of(config).identity()
    task = task if config.places is None else dict(ALL_PLACES)
    place, physics = ("scenario", "options", "people"), ("scheme", "dt", "decision_dt", "manner", "outline")
    return {"task": task, **_of(config, *place, *physics, "start", "seed", "versions")}


def make_env(config: TrainingConfig, envs: int | None = None, threads: int = 1) -> WalkingBatch | RoutingVectorEnv:
    """Return the training batch on ``threads`` threads, by default with the number of environments of the config."""
    num_envs = envs or config.envs
    if config.routing is not None:
        physics = {"scheme": law_of(config), "threads": threads, **_of(config, "dt", "manner", "outline")}
        return RoutingVectorEnv(num_envs=num_envs, **routing_arguments(place_of(config), **physics, **config.routing))
    learned = _of(config, "action", "observation", "reward")
    if config.places is not None:
        own = {"beside": places_of_tasks(config.places.people), **_of(config.places, "people", "seeds", "share")}
        return GeneratedCrowds(num_envs, threads=threads, decision_dt=config.decision_dt, **own, **learned)
    arguments = arguments_of({"threads": threads, **physics_of(config), "frame": config.frame, **learned})
    arguments |= {"num_envs": num_envs, "autoreset": True}
    share = task_of(config).learned_share
    if share is None:
        return CrowdEnv(place_of(config), **arguments)
    return MixedEnv(place_of(config), share=share, **arguments)


def places_of_tasks(people: int) -> list[tuple[Scenario, Conditions]]:
    """Return the places of all tasks of at most ``people`` pedestrians, and the training places of their presets."""
    found = []
    for name, task in TASKS.items():
        if task.learned_share is not None or task.selfish or task.people > people:
            continue
        places, preset = [task.place()], PRESETS.get(name)
        if preset and (preset.people, preset.options) != (task.people, {}):
            places.append(training_place(task.scenario, {**task.options, **preset.options}, preset.people))
        for place in places:
            place = replace(place, time_limit=min(place.time_limit, _LONGEST), strategy=task.rule)
            found.append((place, Conditions(task.scheme, str(task.manner), 0.0)))
    return found


def check_libraries() -> None:
    """Raise ModuleNotFoundError if a library that training needs is missing; the message holds the command to install it."""
    with needed_for("training", "stable-baselines3 tensorboard torch"):
        for library in ("torch", "stable_baselines3", "tensorboard"):
            import_module(library)


def check_budget(**options: float) -> None:
    """Raise ValueError unless all of these numbers are positive and finite."""
    for name, value in options.items():
        number(f"--{name}", value, POSITIVE)


def check_config(config: TrainingConfig) -> None:
    """Raise ValueError if these parameters allow no training; the check makes one environment."""
    people = place_of(config).population.people
    if config.envs * people > MOST_PEOPLE:
        raise ValueError(
            f"--envs is {config.envs}: with {people} people each that is {config.envs * people} at once; "
            f"at most {MOST_PEOPLE} are trained side by side, here --envs {max(MOST_PEOPLE // people, 1)}"
        )
    columns, rows = (config.routing or {}).get("grid", (1, 1))
    if columns * rows > _MOST_CELLS:
        raise ValueError(f"--set grid is {columns} {rows}; it must have at most {_MOST_CELLS} cells")
    if config.routing is not None and config.start != RULE:
        raise ValueError(f"--start is {config.start}: a controller begins at the nearest exits; leave it out")
    env = make_env(config, envs=1)
    if config.start != RULE and not isinstance(env, RoutingVectorEnv):
        rule = Evolved() if config.start == NOTHING else start_of(config)
        rule.act(np.zeros((env.num_people, env.layout.size), dtype=np.float32), env.layout, np.random.default_rng(0))


def read_config(path: Path) -> TrainingConfig:
    """Read the parameters of a run.

    Raises
    ------
    ValueError
        If the file is missing, lacks a parameter, or holds one that is out of range.
    """
    table = read_json(path)
    if not isinstance(table, dict):
        raise ValueError(f"{path} does not hold the parameters of a run")
    names = [field.name for field in fields(TrainingConfig)]
    for name in names:
        if name not in table:
            raise ValueError(f"{path} lacks {name!r}: it was not written by this version of train.py")
    try:
        config = TrainingConfig(**{name: table[name] for name in names})
        check_config(config)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise ValueError(f"cannot resume from {path}: {error}") from None
    return config


def resumed(config: TrainingConfig, given: Plain, curve: Sequence[Mapping[str, float]], name: str) -> TrainingConfig:
    """Return the parameters of a run that is resumed under options from the command line.

    Parameters
    ----------
    config : of the run.
    given : options beside ``--resume``: ``minutes`` and ``steps`` replace the total budget; each other option must equal the
        parameter of the run.
    curve : of the run so far.
    name : of the run.

    Raises
    ------
    ValueError
        If an option differs from a parameter of the run, or a budget leaves nothing to do.
    """
    routing = config.routing or {}
    begun = {**config.as_table(), **routing, "exit": config.options.get("exits"), "unit": config.options.get("unit")}
    begun |= {"place": config.task or config.scenario, "decides": "routing" if routing else "walking"}
    kind = "task" if given.get("place") in (*TASKS, GENERATED) else "scenario"
    words = {"manner": "walking", "place": kind, "dt": "set dt", "outline": "set outline"}
    budget = {option: given[option] for option in ("minutes", "steps") if option in given}
    for option, value in given.items():
        if option not in budget and value != begun.get(option):
            raise ValueError(
                f"--{words.get(option, option)} is {value}, but {name} was begun with {begun.get(option)}: "
                "what is trained cannot change in between; begin another run"
            )
    config = replace(config, **budget)
    if curve and budget:
        spent = {"minutes": curve[-1]["seconds"] / 60.0, "steps": curve[-1]["steps"]}
        for option, done in spent.items():
            if getattr(config, option) <= done:
                raise ValueError(
                    f"{name} has trained for {done:.6g} {option} by now, and --{option} is "
                    f"{getattr(config, option):g} in all: nothing is left to do; give more --{option}"
                )
    return config
