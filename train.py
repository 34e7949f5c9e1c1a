"""Train a policy to lead a crowd out, and compare it with the rules: the main job, also ``make train``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from agents import make_policy
from agents.drivers import policy_driver
from agents.evaluation.comparison import last_times, minus_first, ratio
from agents.evaluation.evaluation import HELD_OUT_SEED, Evaluation, evaluate
from agents.evaluation.report import comparison_table, table_console
from agents.runs import check_name, new_folder
from agents.trained import LearnedPolicy
from agents.training_config import (
    RUNS,
    check_budget,
    check_config,
    check_libraries,
    default_config,
    extended,
    make_env,
    read_config,
)
from crowd_env import make_scenario
from crowd_env.checks import whole
from crowd_env.cli.console import (
    MannerName,
    OutlineOption,
    friendly_errors,
    notes,
    progress_bar,
    run_title,
    with_manner,
)
from crowd_env.files.json_file import write_json
from crowd_env.rendering.libraries import require_libraries

BASELINES = ("shortest", "stand-still", "random")


def train(folder: Path, config: dict[str, Any]) -> bool:
    """Train, or go on training, in ``folder``; False if it was interrupted."""
    from stable_baselines3.common.logger import configure

    from agents.learned import PPOSettings, make_ppo
    from agents.learned.checkpoint import read_checkpoint
    from agents.learned.training import PolicyCallback, read_curve

    notes.print("compiling the physics (half a minute the first time, cached afterwards) ...")
    env = make_env(config)
    model = make_ppo(env, PPOSettings(**config["ppo"]), config["seed"], folder / "tensorboard")
    curve = read_curve(folder / "learning_curve.csv")
    if curve:
        read_checkpoint(folder / "checkpoint.pt", model)
        # The learning loop resets the environment with the seed of the VecEnv.
        venv: Any = model.get_env()
        venv.seed((config["seed"] + model.num_timesteps) % HELD_OUT_SEED)  # other draws
        notes.print(f"going on at {model.num_timesteps} steps")
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    callback = PolicyCallback(
        folder,
        env,
        make_scenario(config["scenario"]),
        max_seconds=60.0 * config["minutes"],
        eval_every=config["eval_every"],
        eval_runs=config["eval_runs"],
        trained={
            "scenario": config["scenario"],
            **_physics(config),
            "seed": config["seed"],
            "versions": config["versions"],
        },
        curve=curve,
    )
    left = config["steps"] - model.num_timesteps
    if left > 0 and (not curve or curve[-1]["seconds"] < 60.0 * config["minutes"]):
        try:
            model.learn(left, callback=callback, reset_num_timesteps=False)
        finally:
            callback.close()
    return not callback.interrupted


def compare(folder: Path, config: dict[str, Any], runs: int) -> list[Evaluation]:
    """Evaluate the rules and the learned policy on the same held-out draws and write ``results.json``."""
    policies = [make_policy(name) for name in BASELINES] + [LearnedPolicy.load(folder / "best.safetensors")]
    results = []
    with progress_bar("evaluating", runs * len(policies)) as progress:
        for policy in policies:
            judged = {"runs": runs, "progress": progress, **_physics(config)}
            results.append(evaluate(policy, config["scenario"], **judged))
    rule, learned = results[BASELINES.index("shortest")], results[-1]
    content = {
        "config": config,
        "learned_minus_shortest": minus_first(learned, rule),
        "learned_over_shortest": ratio(learned, rule),
        "rows": [result.row() for result in results],
    }
    write_json(folder / "results.json", content)
    return results


def _physics(config: dict[str, Any]) -> dict[str, Any]:
    return {name: config[name] for name in ("scheme", "manner", "outline", "dt", "decision_dt")}


def _title(config: dict[str, Any]) -> str:
    place = with_manner(make_scenario(config["scenario"]), config["manner"], config["outline"])
    return run_title(place, config["scheme"])


def draw(folder: Path, config: dict[str, Any], results: list[Evaluation]) -> None:
    """Write learning curve, egress curves and the film of the learned policy beside the rule."""
    from agents.learned.callback import VALIDATION_SEED
    from agents.learned.training import read_curve, score
    from crowd_env.rendering import egress_curves, learning_curve, write_film
    from crowd_env.rendering.live import record

    curve, physics = read_curve(folder / "learning_curve.csv"), _physics(config)
    # The curve was measured on validation draws, so the rule it is compared with is too.
    rule = make_policy("shortest")
    beside = evaluate(rule, config["scenario"], **physics, runs=config["eval_runs"], first_seed=VALIDATION_SEED)
    learning_curve(
        folder / "learning_curve.png",
        [row["steps"] for row in curve],
        {"learned": [row["evacuation_time"] for row in curve]},
        errors={"learned": [row["standard_error"] for row in curve]},
        reference={
            "shortest path": float(last_times(beside).mean()),
            f"kept, best of {len(curve)}": min(curve, key=score)["evacuation_time"],
        },
        title=f"{config['eval_runs']} validation draws at each point, ± standard error",
        xlabel="training steps, all pedestrian slots together",
    )
    shown = {result.policy: result.exit_times for result in results if result.policy in ("shortest", "learned")}
    egress_curves(folder / "egress_curves.png", shown, title=_title(config))
    place = make_scenario(config["scenario"])
    films = [
        record(place, seed=HELD_OUT_SEED, title=title, driver=policy_driver(policy, place, **physics))
        for policy, title in (
            (LearnedPolicy.load(folder / "best.safetensors"), "learned"),
            (rule, "rule: shortest path"),
        )
    ]
    write_film(folder / "evacuation.gif", films)


def main(
    context: typer.Context,
    scenario: Annotated[str, typer.Option(help="Scenario to train in: a name, or a file.")] = "room-v0",
    scheme: Annotated[str, typer.Option(help="Contact scheme.")] = "nsm2",
    dt: Annotated[float | None, typer.Option(help="Physics step in seconds.", show_default="the scheme's own")] = None,
    manner: MannerName = None,
    outline: OutlineOption = None,
    minutes: Annotated[float, typer.Option(help="Training stops after this many minutes, if not by then done.")] = 7.5,
    steps: Annotated[int, typer.Option(help="Training steps, summed over all pedestrian slots.")] = 16_000_000,
    envs: Annotated[int, typer.Option(help="Rooms simulated side by side.")] = 64,
    seed: Annotated[int, typer.Option(help="Fixes draws and network; below 1000000.")] = 0,
    runs: Annotated[int, typer.Option(help="Held-out evacuations per policy in the final table.")] = 50,
    name: Annotated[
        str, typer.Option(help="Folder below runs/; made from scenario, scheme and seed if not given.")
    ] = "",
    root: Annotated[Path, typer.Option(help="Where the folders of runs are.")] = Path("runs"),
    resume: Annotated[
        str, typer.Option(help="Name of a run to go on with; --minutes and --steps then are its budget in all.")
    ] = "",
) -> None:
    """Train a shared policy by PPO and compare it with the rules on the same held-out draws.

    Example: python train.py --scheme dem --minutes 3
    """
    folder: Path | None = None

    def kept() -> str:
        elsewhere = "" if root == Path("runs") else f" --root {root}"
        return "" if folder is None else f"go on with: python train.py --resume {folder.name}{elsewhere}"

    with friendly_errors(kept):
        check_budget(minutes=minutes, steps=steps, envs=envs)
        whole("--runs", runs, RUNS)
        check_libraries()
        require_libraries(".png")
        given = _given(context)
        if "resume" in given:
            folder, config = _resumed(root, resume, given)
        else:
            config = default_config(scenario, scheme, seed, envs, steps, minutes, dt, manner, outline)
            check_config(config)
            who = "".join(f"-{given_name}" for given_name in (manner, outline) if given_name is not None)
            folder = new_folder(root, name or f"{Path(scenario).stem}-{scheme}{who}-seed{seed}")
        write_json(folder / "config.json", config)
        notes.print(f"writing to {folder}/")
        if not train(folder, config):
            raise KeyboardInterrupt
        results = compare(folder, config, runs)
        table_console().print(comparison_table(results, f"{_title(config)}, {runs} held-out draws"))
        draw(folder, config, results)
    notes.print(f"model, config, results.json, figures and film: {folder}/")


def _given(context: typer.Context) -> dict[str, Any]:
    """Return the options that were written on the command line."""
    return {
        name: value
        for name, value in context.params.items()
        if str(getattr(context.get_parameter_source(name), "name", "")) == "COMMANDLINE"
    }


def _resumed(root: Path, resume: str, given: dict[str, Any]) -> tuple[Path, dict[str, Any]]:
    """Return folder and parameters of a run that is gone on with."""
    from agents.learned.training import read_curve

    check_name(resume)
    if "name" in given:
        raise ValueError(f"--name {given['name']} beside --resume {resume}: a run keeps its name; leave --name out")
    folder = root / resume
    config = read_config(folder / "config.json")
    curve = read_curve(folder / "learning_curve.csv")
    if (folder / "checkpoint.zip").exists() or (folder / "best.npz").exists():
        raise ValueError(f"{folder} was written by an earlier version, which this one cannot go on with")
    of_run = {option: value for option, value in given.items() if option not in ("runs", "root", "resume")}
    return folder, extended(config, of_run, curve, resume)


if __name__ == "__main__":
    typer.run(main)
