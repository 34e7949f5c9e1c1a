"""The parameters of a training run: made, checked, and read again when the run is continued."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from agents.evaluation.evaluation import HELD_OUT_SEED
from agents.runs import versions
from crowd_env import CrowdEnv, ObservationLayout, make_scenario, make_scheme
from crowd_env.checks import POSITIVE, Range, number, whole
from crowd_env.files.json_file import read_json
from crowd_env.headway import plain_manner
from crowd_env.outline import plain_outline

# People simulated side by side in training: a rollout of more takes many gigabytes.
MOST_PEOPLE = 200_000
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
) -> dict[str, Any]:
    """Return every parameter of a run; unless given, ``dt`` [s] is the scheme's own, manner and outline are the scenario's."""
    from agents.learned import PPOSettings
    from agents.learned.callback import VALIDATION_SEED

    return {
        "scenario": scenario,
        "scheme": scheme,
        "seed": seed,
        "envs": envs,
        "steps": steps,
        "minutes": minutes,
        "dt": make_scheme(scheme).info.default_dt if dt is None else dt,
        "decision_dt": 0.1,
        "manner": plain_manner(make_scenario(scenario).manner_of_run(manner)),
        "outline": plain_outline(make_scenario(scenario).outline_of_run(outline)),
        "frame": "path",
        "action": "continuous",
        "observation": ObservationLayout().as_table(),
        "reward": {"weights": {"progress": 0.5, "time": 1.0}, "team_share": 0.5},
        "ppo": asdict(PPOSettings()),
        "eval_every": 1_500_000,
        "eval_runs": 500,
        "validation_seed": VALIDATION_SEED,
        "held_out_seed": HELD_OUT_SEED,
        "versions": versions(),
    }


def make_env(config: Mapping[str, Any], envs: int | None = None) -> CrowdEnv:
    """Return the training batch, of ``envs`` rooms if that is given."""
    options = ("scheme", "dt", "decision_dt", "frame", "action", "observation", "reward", "manner", "outline")
    return CrowdEnv(
        config["scenario"],
        num_envs=config["envs"] if envs is None else envs,
        autoreset=True,
        **{name: config[name] for name in options},
    )


def check_libraries() -> None:
    """Raise ModuleNotFoundError now, not after the training, if a library is missing; say how to install it."""
    try:
        import safetensors.numpy  # noqa: F401

        import agents.learned  # noqa: F401
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"training needs {error.name}, which is not installed: pip install safetensors stable-baselines3 tensorboard torch",
            name=error.name,
        ) from None


def check_budget(**options: float) -> None:
    """Raise ValueError unless all of these are > 0 and finite."""
    for name, value in options.items():
        number(f"--{name}", value, POSITIVE)


def check_envs(envs: int, people: int) -> None:
    """Raise ValueError if ``envs`` evacuations of ``people`` people each are too many to train in side by side."""
    if envs * people > MOST_PEOPLE:
        raise ValueError(
            f"--envs is {envs}: with {people} people each that is {envs * people} at once; "
            f"at most {MOST_PEOPLE} are trained side by side, here --envs {max(MOST_PEOPLE // people, 1)}"
        )


def check_config(config: Mapping[str, Any]) -> None:
    """Raise ValueError if nothing can be trained with these parameters; one room is made to see."""
    from agents.learned import PPOSettings

    PPOSettings(**config["ppo"])
    whole("seed", config["seed"], SEEDS)
    check_budget(minutes=config["minutes"], steps=config["steps"], envs=config["envs"])
    number("--dt", config["dt"], LEAST_DT, "s")
    check_envs(config["envs"], make_scenario(config["scenario"]).population.count)
    make_env(config, envs=1)


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
    for option, value in given.items():
        if option in ("minutes", "steps"):
            found[option] = value
        elif value != config[option]:
            raise ValueError(
                f"--{option} is {value}, but {name} was begun with {config[option]}: "
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
