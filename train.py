"""Train a policy to lead a crowd out, and compare it with the rules: the main job, also ``make train``."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console
from rich.progress import track

from agents import make_policy
from agents.evaluation import HELD_OUT_SEED, Evaluation, evaluate
from agents.report import comparison_table
from agents.runs import new_folder, read_json, versions, write_json
from crowd_env import CrowdEnv, ObservationLayout, RewardWeights, make_scenario, make_scheme

BASELINES = ("random", "stand-still", "shortest")
console = Console(stderr=True)


def default_config(scenario: str, scheme: str, seed: int, envs: int, steps: int, minutes: float) -> dict[str, Any]:
    """Return every parameter of a run."""
    from agents.learned import PPOSettings
    from agents.learned.training import VALIDATION_SEED

    return {
        "scenario": scenario,
        "scheme": scheme,
        "seed": seed,
        "envs": envs,
        "steps": steps,
        "minutes": minutes,
        "dt": 0.01,
        "decision_dt": 0.1,
        "frame": "path",
        "action": "continuous",
        "observation": asdict(ObservationLayout()),
        "reward": {"weights": {"progress": 0.5, "time": 1.0}, "team_share": 0.5},
        "ppo": asdict(PPOSettings()),
        "eval_every": 1_500_000,
        "eval_runs": 200,
        "validation_seed": VALIDATION_SEED,
        "held_out_seed": HELD_OUT_SEED,
        "versions": versions(),
    }


def make_env(config: dict[str, Any]) -> CrowdEnv:
    """Return the training batch."""
    return CrowdEnv(
        config["scenario"],
        num_envs=config["envs"],
        scheme=config["scheme"],
        dt=config["dt"],
        decision_dt=config["decision_dt"],
        frame=config["frame"],
        action=config["action"],
        observation=ObservationLayout(**config["observation"]),
        reward=RewardWeights(**config["reward"]),
        autoreset=True,
    )


def train(folder: Path, config: dict[str, Any]) -> bool:
    """Train, or go on training, in ``folder``; False if it was interrupted."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.logger import configure

    from agents.learned import LearnedPolicy, PPOSettings, make_ppo
    from agents.learned.training import Companion, read_curve

    torch.set_num_threads(1)  # the networks are small: a second thread costs more than it brings
    console.print("compiling the physics (half a minute the first time, cached afterwards) ...")
    env = make_env(config)
    model = make_ppo(env, PPOSettings(**config["ppo"]), config["seed"], folder / "tensorboard")
    checkpoint = folder / "checkpoint.zip"
    curve = read_curve(folder / "learning_curve.csv")
    if checkpoint.exists():
        LearnedPolicy.load(checkpoint)  # a clear error if the file is broken
        loaded = PPO.load(checkpoint, device="cpu")
        model.set_parameters(cast(Any, loaded.get_parameters()))
        model.num_timesteps = loaded.num_timesteps
        # The learning loop resets the environment with the seed of the VecEnv.
        cast(Any, model.get_env()).seed((config["seed"] + loaded.num_timesteps) % HELD_OUT_SEED)  # other draws
        console.print(f"going on at {model.num_timesteps} steps")
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    companion = Companion(
        folder,
        env,
        make_scenario(config["scenario"]),
        total_steps=config["steps"],
        max_seconds=60.0 * config["minutes"],
        eval_every=config["eval_every"],
        eval_runs=config["eval_runs"],
        curve=curve,
    )
    left = config["steps"] - model.num_timesteps
    if left > 0 and (not curve or curve[-1]["seconds"] < 60.0 * config["minutes"]):
        model.learn(left, callback=companion, reset_num_timesteps=False)
    return not companion.interrupted


def compare(folder: Path, config: dict[str, Any], runs: int) -> list[Evaluation]:
    """Evaluate the rules and the learned policy on the same held-out draws; write table and pictures."""
    from agents.learned import LearnedPolicy

    policies = [make_policy(name) for name in BASELINES] + [LearnedPolicy.load(folder / "best.zip")]
    results = []
    for policy in track(policies, description="evaluating", console=console, transient=True):
        results.append(evaluate(policy, config["scenario"], **_physics(config), runs=runs))
    rows = [result.row() for result in results]
    rule, learned = rows[BASELINES.index("shortest")], rows[-1]
    ratio = None
    if rule["evacuation_time"]["mean"] and learned["evacuation_time"]["mean"]:
        ratio = learned["evacuation_time"]["mean"] / rule["evacuation_time"]["mean"]
    write_json(folder / "results.json", {"config": config, "learned_over_shortest": ratio, "rows": rows})
    return results


def _physics(config: dict[str, Any]) -> dict[str, Any]:
    return {name: config[name] for name in ("scheme", "dt", "decision_dt")}


def draw(folder: Path, config: dict[str, Any], results: list[Evaluation]) -> None:
    """Write learning curve, egress curves and the film of the learned policy beside the rule."""
    from agents.film import record
    from agents.learned import LearnedPolicy
    from agents.learned.training import VALIDATION_SEED, read_curve, score
    from crowd_env.rendering import egress_curves, learning_curve, write_film

    curve = read_curve(folder / "learning_curve.csv")
    # The curve was measured on validation draws, so the rule it is compared with is too.
    rule = evaluate(
        make_policy("shortest"),
        config["scenario"],
        **_physics(config),
        runs=config["eval_runs"],
        first_seed=VALIDATION_SEED,
    )
    learning_curve(
        folder / "learning_curve.png",
        [row["steps"] for row in curve],
        {"learned": [row["evacuation_time"] for row in curve]},
        reference={
            "shortest path": rule.row()["evacuation_time"]["mean"] or float("nan"),
            "kept policy": min(curve, key=score)["evacuation_time"],
        },
        xlabel="training steps, all pedestrian slots together",
    )
    shown = {result.policy: result.exit_times for result in results if result.policy in ("shortest", "learned")}
    egress_curves(folder / "egress_curves.png", shown, title=f"{config['scenario']}, {config['scheme']}")
    films = [
        record(
            LearnedPolicy.load(folder / "best.zip"), config["scenario"], scheme=config["scheme"], title="learned policy"
        ),
        record(make_policy("shortest"), config["scenario"], scheme=config["scheme"], title="rule: shortest path"),
    ]
    write_film(folder / "evacuation.gif", films)


def main(
    scenario: Annotated[str, typer.Option(help="Scenario to train in.")] = "room-v0",
    scheme: Annotated[str, typer.Option(help="Contact scheme.")] = "nsm2",
    minutes: Annotated[float, typer.Option(help="Training stops after this many minutes, if not by then done.")] = 7.5,
    steps: Annotated[int, typer.Option(help="Training steps, summed over all pedestrian slots.")] = 16_000_000,
    envs: Annotated[int, typer.Option(help="Rooms simulated side by side.")] = 64,
    seed: Annotated[int, typer.Option(help="Fixes draws and network; below 1000000.")] = 0,
    runs: Annotated[int, typer.Option(help="Held-out evacuations per policy in the final table.")] = 50,
    name: Annotated[
        str, typer.Option(help="Folder below runs/; made from scenario, scheme and seed if not given.")
    ] = "",
    root: Annotated[Path, typer.Option(help="Where the folders of runs are.")] = Path("runs"),
    resume: Annotated[str, typer.Option(help="Name of an interrupted run to go on with.")] = "",
) -> None:
    """Train a shared policy by PPO and compare it with the rules on the same held-out draws.

    Example: python train.py --scheme dem --minutes 3
    """
    try:
        for option, value in (("minutes", minutes), ("steps", steps), ("envs", envs), ("runs", runs)):
            if not 0 < value < float("inf"):
                raise ValueError(f"--{option} is {value}; it must be > 0 and finite")
        if resume:
            folder = root / resume
            config = read_json(folder / "config.json")
        else:
            if not 0 <= seed < 1_000_000:
                raise ValueError(f"seed is {seed}; it must be 0 to 999999 (larger ones are kept for evaluation)")
            make_scheme(scheme)
            make_scenario(scenario)
            config = default_config(scenario, scheme, seed, envs, steps, minutes)
            folder = new_folder(root, name or f"{scenario}-{scheme}-seed{seed}")
            write_json(folder / "config.json", config)
        console.print(f"writing to {folder}/")
        if not train(folder, config):
            elsewhere = "" if root == Path("runs") else f" --root {root}"
            command = f"python train.py --resume {folder.relative_to(root)}{elsewhere}"
            console.print(f"stopped; go on with: {command}", soft_wrap=True, highlight=False)
            raise typer.Exit(130)
        results = compare(folder, config, runs)
    except ValueError as error:
        console.print(f"error: {error}", style="red", highlight=False)
        raise typer.Exit(2) from None
    Console().print(comparison_table(results, f"{config['scenario']}, {config['scheme']}, {runs} held-out draws"))
    draw(folder, config, results)
    console.print(f"model, config, results.json, figures and film: {folder}/")


if __name__ == "__main__":
    typer.run(main)
