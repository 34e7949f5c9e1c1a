"""Minari: python examples/clients/minari_dataset.py --runs 10 [--policy evolution]

A dataset of runs, an episode a pedestrian; ``options`` of an episode say which of them walked beside each other.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import minari
import typer

from crowd_env.agents import make_policy
from crowd_env.agents.tasks import make_task
from crowd_env.agents.transitions import write_minari, write_runs


def main(
    runs: Annotated[int, typer.Option(min=1)] = 10,
    policy: str = "evolution",
    task: str = "room",
    dataset: str = "crowd_env/room/evolution-v0",
) -> minari.MinariDataset:
    """Run a policy in a task, and read the dataset that comes of it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "runs.npz"
        write_runs(path, make_policy(policy), make_task(task), runs)
        write_minari(dataset, path)
    found = minari.load_dataset(dataset)
    rewards = [episode.rewards.sum() for episode in found]
    print(f"{dataset}: {len(found)} episodes, {found.total_steps} decisions, return {sum(rewards) / len(rewards):.2f}")
    return found


if __name__ == "__main__":
    typer.run(main)
