"""The size of the house, in one table: a feature pays with lines, and a change that raises a ceiling says what for."""

import ast
import inspect
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import grimp
import pytest
import typer
from repository import ROOT

import crowd_env
from crowd_env.cli.main import app

pytestmark = pytest.mark.more

CEILINGS = {
    "rooms": 18,
    "floors": 11,
    "arrows between rooms": 90,
    # Ways by body size, around corners, over wide openings; time limits, policies in run, mending of plans, crowding, locks.
    # Kernels that are installed, and shared by checkouts; decisions about eight people at a time; fields of large places;
    # fewer rows of nsm1; hertz at a step of its own, of second order; restarts at once; lists of pairs by all threads; ways
    # fetched early; fewer loops of hertz; rooms observed by who moves them; crowds that stand; places
    # without end; places turned and mirrored, submissions on draws of their own; runs written as arrays;
    # openings ahead, places of one's own between generated ones, and how they are judged; how long one has stood; a footbridge,
    # its walkers and its gatekeeper; companions and attractions; balance; grains; and what is reproduced of them; graphs of
    # networks that act between two speeds.
    "code lines of crowd_env, commands of agents within": 26_630,
    # A submission is made anew from its runs; policies in run; crowds at rest are passed over, what rules do ships; probes of
    # tasks, noise and delay, networks and own draws in submissions; a dilemma, and crowds of two policies; tiers, people
    # who are unseen, MAPPO, runs as arrays, tasks for other libraries; one policy for all places, its teachers and judges,
    # a search that begins anew, a critic on the layers of its actor; who yields when stuck; who left by the way in;
    # acting between two speeds.
    "code lines of agents": 5_290,
    # Sharper criteria of walking; tiers, cards, generated places; heads that are pushed, waves, people who stay together;
    # what several seeds learn.
    "code lines of validation": 2_900,
    "code lines of benchmarks": 1_140,  # the wheel of kernels; processes beside threads; two pictures; where a training goes
    # Who walks by default, what a report collects, forces, the wheel of kernels, a loose nsm1, large places, the step of hertz,
    # a page about speed, places without end, how submissions are kept honest, a dilemma and its two tasks,
    # a page of the benchmark, one policy for every place; bridge, grains, companions, balance: what is in them, and found;
    # five seeds; who is out, and what is blocked; how the one policy does on the tasks.
    "words of docs, tables that programs write left out": 39_750,
    "arguments of CrowdEnv": 12,
    "arguments of parallel_env": 12,
    "arguments of make_vec": 13,  # render_mode, which Gymnasium asks for
    "options of run": 20,
    "options of any command": 20,
}


def code_lines(path: Path) -> int:
    """Return the lines of a source that hold code: no docstring, no comment, not blank."""
    source = path.read_text(encoding="utf-8")
    texts = {
        line
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    nothing = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    code = {line for token in tokens if token.type not in nothing for line in range(token.start[0], token.end[0] + 1)}
    return len(code - texts)


def lines_below(folder: str) -> int:
    paths = [
        path
        for path in (ROOT / folder).rglob("*.py")
        if not (folder == "crowd_env" and "agents" in path.relative_to(ROOT).parts[1:2])
    ]
    assert paths
    return sum(map(code_lines, paths))


def words_of_docs() -> int:
    written = re.compile(r"<!-- table: .*?-->.*?<!-- end -->", re.DOTALL)
    return sum(len(written.sub("", path.read_text(encoding="utf-8")).split()) for path in (ROOT / "docs").rglob("*.md"))


def rooms() -> dict[str, set[str]]:
    """Return room -> rooms that it imports from, of everything but the tests; train.py is the one above all."""

    def room(module: str) -> str:
        package, *parts = module.split(".")
        return package if package != "crowd_env" or not parts else parts[0]

    graph = grimp.build_graph("crowd_env", "validation", "benchmarks", cache_dir=None)
    # The looks up, as in the contract of the layers: what draws an environment or a recording is loaded when it is drawn.
    for module in ("crowd_env.envs.parallel", "crowd_env.envs.controlled"):
        for drawing in ("crowd_env.rendering", "crowd_env.rendering.frames"):
            graph.remove_import(importer=module, imported=drawing)
    graph.remove_import(importer="crowd_env.recording.recording", imported="crowd_env.rendering")
    found: dict[str, set[str]] = {"train": {"cli"}}
    for module in graph.modules:
        names = {room(other) for other in graph.find_modules_directly_imported_by(module)}
        found.setdefault(room(module), set()).update(names - {room(module)})
    return found


def floors(uses: dict[str, set[str]]) -> Iterator[set[str]]:
    """Yield the rooms floor by floor, from the ground up; a circle is an error."""
    left = dict(uses)
    while left:
        floor = {name for name, used in left.items() if not used & set(left)}
        assert floor, f"rooms that use each other in a circle are among {sorted(left)}"
        yield floor
        left = {name: used for name, used in left.items() if name not in floor}


def options() -> dict[str, int]:
    """Return command -> number of its options and arguments, beside --help."""
    group = typer.main.get_command(app)
    context = typer.Context(group)
    commands = {name: group.get_command(context, name) for name in group.list_commands(context)}
    return {name: sum("--help" not in option.opts for option in command.params) for name, command in commands.items()}


def test_the_house_stays_below_its_ceilings():
    uses, asked = rooms(), options()
    measured = {
        "rooms": len(uses),
        "floors": len(list(floors(uses))),
        "arrows between rooms": sum(map(len, uses.values())),
        "code lines of crowd_env, commands of agents within": lines_below("crowd_env"),
        "code lines of agents": lines_below("agents"),
        "code lines of validation": lines_below("validation"),
        "code lines of benchmarks": lines_below("benchmarks"),
        "words of docs, tables that programs write left out": words_of_docs(),
        "arguments of CrowdEnv": len(inspect.signature(crowd_env.CrowdEnv).parameters),
        "arguments of parallel_env": len(inspect.signature(crowd_env.parallel_env).parameters),
        "arguments of make_vec": len(inspect.signature(crowd_env.make_vec).parameters),
        "options of run": asked["run"],
        "options of any command": max(asked.values()),
    }
    assert measured.keys() == CEILINGS.keys()
    print(*(f"{measured[name]:7d} of {ceiling:6d}  {name}" for name, ceiling in CEILINGS.items()), sep="\n")
    over = {name: (measured[name], ceiling) for name, ceiling in CEILINGS.items() if measured[name] > ceiling}
    assert not over, "measured, ceiling"


def test_a_circle_is_seen():
    with pytest.raises(AssertionError, match="circle"):
        list(floors({"a": {"b"}, "b": {"a"}, "c": set()}))


def test_lines_of_text_are_no_code(tmp_path):
    path = tmp_path / "a.py"
    path.write_text('"""A\n\nb."""\n\n# c\nx = """d\ne"""\n\n\ndef f():\n    """G."""\n    return 1  # h\n')
    assert code_lines(path) == 4
