"""Runs of train.py, as small as can be, that several test files share."""

import csv
from dataclasses import replace

from late import late
from typer import Typer
from typer.testing import CliRunner

from crowd_env.agents.training_config import default_config
from crowd_env.cli.agents import learn

torch = late("torch")
app = Typer(pretty_exceptions_enable=False)
app.command()(learn.main)


def call(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def curve(folder):
    with (folder / "learning_curve.csv").open() as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def checkpoint(folder):
    return torch.load(folder / "checkpoint.pt", weights_only=True)


QUICK = {"n_steps": 32, "batch_size": 256, "n_epochs": 1}


def with_ppo(config, **settings):
    """Return a config with other hyperparameters."""
    return replace(config, ppo=replace(config.ppo, **settings))


def tiny(folder, **changes):
    """Return the config of a run of a few seconds in a folder of its own."""
    folder.mkdir(parents=True)
    config = default_config("room-v0", "nsm2", 3, 2, 5000, 5.0)
    return with_ppo(replace(config, **{"eval_every": 2500, "eval_runs": 2} | changes), **QUICK)
