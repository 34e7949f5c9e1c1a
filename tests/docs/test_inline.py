"""Commands inside of sentences: the program is there, and has the command and the options that are named."""

import re
import shlex
from importlib import import_module
from importlib.util import find_spec

import pytest
import typer
from cases import looped
from installations import check_make, check_pip
from repository import ROOT
from shown import PAGES, blocks_of, named

from crowd_env.cli.main import app

pytestmark = pytest.mark.more

# Programs that are called as `python -m NAME` -> the module with its command line.
COMMAND_LINES = {
    "crowd_env.agents.benchmark": "crowd_env.cli.agents.benchmark",
    "benchmarks": "benchmarks.cli",
    "validation": "validation.cli",
}
# Target of make -> the module that takes its ARGS.
MADE_BY = {"train": "crowd_env.cli.agents.learn", "map": "validation", "bench": "benchmarks"}
STANDS_FOR_MORE = re.compile(r"\.\.\.|\[|\|")  # "crowd-env run ... --film out.mp4", "[--json]", "FILE.sqlite|.h5"

OF_AN_EXAMPLE = "crowd-env reproduce two-fig1 --set width=1.2"  # of a paper that the block above it has made up


def sentences_of(page):
    """Return the commands between backticks of a page, outside of its blocks."""
    text = page.read_text(encoding="utf-8")
    for block in blocks_of(page):
        text = text.replace(block.text, "")
    found = re.findall(r"`((?:crowd-env|python3?|make|pip) [^`]+)`", text)
    return list(dict.fromkeys(one for one in found if not STANDS_FOR_MORE.search(one) and one != OF_AN_EXAMPLE))


SENTENCES = {page: sentences_of(page) for page in PAGES if page.name != "CHANGELOG.md"}


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


@looped("page", [page for page, found in SENTENCES.items() if found], ids=named)
def test_commands_in_sentences_are_understood(page):
    for sentence in SENTENCES[page]:
        words = shlex.split(sentence)
        match words:
            case ["crowd-env", *rest]:
                check_words(typer.main.get_command(app), rest)
            case ["python" | "python3", "-m", module, *rest]:
                assert find_spec(module), sentence
                if module != "pytest" and not module.startswith("examples."):
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
