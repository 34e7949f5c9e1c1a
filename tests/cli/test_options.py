"""Options: sentences name those that there are, and each is turned by somebody."""

import ast
import inspect
import re
from collections import Counter

import pytest
import typer
from repository import ROOT

import benchmarks.cli
import crowd_env
import validation.cli
from crowd_env.cli.main import app

pytestmark = pytest.mark.more

_NAMED = re.compile(r"(?<![\w-])--[a-z][a-z-]*[a-z]\b(?![-{])")
_ALWAYS = {"--help", "--install-completion", "--show-completion"}
# Options of other programs: ray.
_FOREIGN = {"--working-dir"}
_FOLDERS = {"crowd_env": (), "agents": (), "validation": (validation.cli.app,), "benchmarks": (benchmarks.cli.run,)}


def commands_of(application):
    """Return the commands of an application, itself among them."""
    if not isinstance(application, typer.Typer):
        function, application = application, typer.Typer(add_completion=False)
        application.command()(function)
    found = typer.main.get_command(application)
    context = typer.Context(found)
    names = found.list_commands(context) if hasattr(found, "list_commands") else ()
    return [found, *(found.get_command(context, name) for name in names)]


def options_of(application):
    """Return the options of all commands of an application."""
    parameters = [one for command in commands_of(application) for one in command.params]
    return {option.strip() for one in parameters for option in (*one.opts, *one.secondary_opts)}


def sources(*folders):
    """Return the syntax tree of every source below folders, by its path."""
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths if "crowd_env/agents/" not in str(path)}


def test_sentences_name_only_options_that_there_are():
    ours = options_of(app) | _ALWAYS | _FOREIGN
    unknown = []
    for folder, beside in _FOLDERS.items():
        known = ours.union(*map(options_of, beside))
        for path, tree in sources(folder).items():
            texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
            named = [(option, text.lineno) for text in texts for option in _NAMED.findall(text.value)]
            unknown += [f"{path.relative_to(ROOT)}:{line} {one}" for one, line in named if one not in known]
    assert not unknown, "\n".join(unknown)


# ------------------------------------------------------------------------------------------- options that nobody turns

# Keywords that users alone turn: constants of laws, and what a place may say.
_OF_USERS = {
    "Attraction": {"lifetime"},
    "Balance": {"arms", "base", "give", "grip", "swing", "walks_from"},
    "GroupCohesion": {"cohesion", "patience", "repulsion"},
    "Headway": {
        *("anticipation", "berth", "impatience", "keep_right", "keep_up", "off_walls", "oncoming", "overtaking"),
        *("patience", "shyness", "sight"),
    },
    "Outline": {"max_torque", "turning_time"},
    "Route": {"via"},
    "Scenario": {"closed_doors"},
}


def keywords_given(trees):
    """Return how often each keyword is given in a call, or named as a key of a table of keywords."""
    found = Counter()
    for tree in trees:
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                found.update(one.arg for one in node.keywords if one.arg)
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
                found[node.value] += 1
    return found


def test_each_keyword_of_a_public_function_is_given_by_somebody():
    given = keywords_given(sources("crowd_env", "agents", "validation", "benchmarks").values())
    dead = {}
    for name in crowd_env.__all__:
        thing = getattr(crowd_env, name)
        if callable(thing):
            keywords = [
                one.name
                for one in inspect.signature(thing).parameters.values()
                if one.default is not one.empty and one.kind in (one.KEYWORD_ONLY, one.POSITIONAL_OR_KEYWORD)
            ]
            if unturned := {one for one in keywords if not given[one]} - _OF_USERS.get(name, set()):
                dead[name] = sorted(unturned)
    print(dead)
    assert not dead, f"nobody outside of tests, pages and examples turns {dead}"


def test_each_option_of_a_command_is_shown_or_turned():
    """An option that no page, example or table shows, and no help by an example, is one that nobody needs."""
    files = [*(ROOT / "docs").rglob("*.md"), *(ROOT / "docs/tables").glob("*.csv"), ROOT / "README.md"]
    files += [ROOT / "Makefile", ROOT / "CONTRIBUTING.md", *(ROOT / "examples").rglob("*.py")]
    files += [*(ROOT / "validation").rglob("*.py"), *(ROOT / ".github").rglob("*.yml"), ROOT / ".ci/run"]
    commands = commands_of(app)[1:]
    helps = [f"{one.help}\n{one.epilog}" for one in commands]
    shown = set(_NAMED.findall("\n".join([*helps, *(path.read_text(encoding="utf-8") for path in files)])))
    dead = []
    for command in commands:
        for one in command.params:
            options = {option.strip() for option in (*one.opts, *one.secondary_opts) if option.strip().startswith("--")}
            if options and not options & (shown | _ALWAYS):
                dead.append(f"{command.name} {' '.join(sorted(options))}")
    assert not dead, "\n".join(dead)
