"""Commands that are named, but not run: the program is there, and has the command and the options."""

import shlex
from importlib import import_module
from importlib.util import find_spec

import typer
from installations import check_make, check_pip
from repository import ROOT

from crowd_env.cli.main import app

# Programs that are called as `python -m NAME` -> the module with its command line.
COMMAND_LINES = {
    "benchmarks": "benchmarks.cli",
    "validation": "validation.cli",
}
WITHOUT_OPTIONS = ("benchmarks.pictures", "validation.seeds")
# Target of make -> the module that takes its ARGS.
MADE_BY = {"train": "crowd_env.cli.agents.learn", "map": "validation", "bench": "benchmarks"}


def application(module):
    """Return the command line of a module as click has it."""
    found = import_module(COMMAND_LINES.get(module, module))
    if hasattr(found, "app"):
        return typer.main.get_command(found.app)
    alone = typer.Typer(add_completion=False)
    alone.command()(found.run)
    return typer.main.get_command(alone)


def check_words(command, words):
    """Check that a command line has the commands and the options in these words; values may stand for others."""
    context = command.context_class(command)
    if hasattr(command, "get_command"):
        if "cases" in command.commands and words[:1] and words[0] not in command.commands:
            words = ["cases", *words]  # of validation, which understands words that name no command so
        if not words or words[0].startswith("--"):
            command.make_parser(context).parse_args(list(words))
            return
        inner = command.get_command(context, words[0])
        assert inner is not None, f"no command {words[0]}"
        check_words(inner, words[1:])
        return
    left = [word for word in words if word not in command.get_help_option_names(context)]
    named_alone = left[-1:] if left and left[-1].startswith("--") else []  # `run --out`: its value is not said
    command.make_parser(context).parse_args([*left, *("a value" for _ in named_alone)])


def check_command(sentence):
    """Check that a command line is understood by its program."""
    words = shlex.split(sentence)
    match words:
        case ["crowd-env", *rest]:
            check_words(typer.main.get_command(app), rest)
        case ["python" | "python3", "-m", module, *rest]:
            assert find_spec(module), sentence
            if module not in ("pytest", *WITHOUT_OPTIONS) and not module.startswith("examples."):
                check_words(application(module), rest)
        case ["python" | "python3", script] if script.startswith("examples/"):
            assert (ROOT / script).exists(), sentence
        case ["python" | "python3", script, *rest] if script.endswith(".py"):
            assert script == "train.py" and (ROOT / script).exists(), sentence
            check_words(application("crowd_env.cli.agents.learn"), rest)
        case ["make", target, *variables]:
            check_make(words)
            for one in variables:
                if one.startswith("ARGS=") and target in MADE_BY:
                    check_words(application(MADE_BY[target]), shlex.split(one.removeprefix("ARGS=")))
        case ["pip", "install", _, *_]:
            check_pip(words)
        case ["pip" | "python", "install" | "--version"]:
            pass
        case _:
            raise AssertionError(f"no test knows how to try {sentence!r}")
