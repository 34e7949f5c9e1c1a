"""How each program that a page shows is tried: for real, but with few people, one draw, trainings of a moment, small films.

What cannot be run here (an installation, other machines, minutes of measuring) is said where it is left out; all of its words
are read all the same, by the program itself.
"""

import os
import re
import runpy
import subprocess
import sys
import venv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from installations import check_make, check_pip
from outputs import WIDTH
from repository import ROOT
from shown import Command
from typer.testing import CliRunner

import benchmarks.cli
import validation.cli
from benchmarks.measuring import Row
from crowd_env.agents.benchmark.jobs import ALGORITHMS
from crowd_env.agents.evaluation import same_draws
from crowd_env.agents.pretrained import load
from crowd_env.agents.rules import ShortestPath
from crowd_env.agents.tasks import TASKS
from crowd_env.cli.agents import learn
from crowd_env.cli.main import app
from crowd_env.core.files.csv_table import write_csv

FEW = 8  # people
# Option -> what it is given instead of what is shown.
SMALL = {"--runs": "1", "--n": str(FEW), "--people": str(FEW), "--seeds": "1"}
# Word of a command -> options that are added to it, so that it has little to do.
ADDED = {
    "film": ["--width", "320", "--fps", "1"],
    "show": ["--film-width", "320", "--film-fps", "1"],
    "lin-fig4": ["--workers", "1"],
    "--scenario": ["--people", str(FEW)],
    "crowd_env.cli.agents.submit": ["--robustness-runs", "0"],
    "crowd_env.cli.agents.benchmark": ["--runs", "1", "--baselines", "rule"],
    "--peers": ["scaling"],  # one case alone
}
MINUTES_LONG = {"lin": "lin-fig4", "lin-fig5": "lin-fig4"}  # of the figures of this paper, the shortest one


def workplace(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Go into a folder where what commands read of the repository is found, and which is theirs to write into.

    What readers have made themselves, by the names that the pages give it, lies there too.
    """
    for name in ("examples", "constraints.txt", "pyproject.toml", "train.py"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "runs" / "NAME").mkdir(parents=True)
    for path in ("runs/NAME/best.safetensors", "learned.safetensors"):
        load("competitive-door/ppo").save(folder / path)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", WIDTH)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)


def smaller(words: list[str]) -> list[str]:
    """Return a command that does the least that shows that all of its words are right."""
    # Clusters are those of tests/agents/test_cluster.py.
    words = [MINUTES_LONG.get(word, word) for word in words if word != "--ray"]
    for option, value in SMALL.items():
        if option in words:
            words[words.index(option) + 1] = value
    for word, options in ADDED.items():
        if word in words:
            words += options
    return words


def run_crowd_env(words: list[str], monkeypatch: pytest.MonkeyPatch) -> str:
    """Run a command of ours, and return what it prints."""
    few_people(monkeypatch)
    result = CliRunner().invoke(app, smaller(words[1:]))
    assert result.exit_code == 0, result.output
    return result.stdout


def run_python(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a module or a script, in this process, as the interpreter would."""
    if words[1:3] == ["-m", "venv"]:
        venv.create(words[3], with_pip=False)
        (Path(words[3]) / "bin" / "pip").touch()  # installing it takes seconds
        return
    for one in (few_people, short_trainings, measure_nothing):
        one(monkeypatch)
    words = smaller(words)
    named, arguments = (words[2], words[3:]) if words[1] == "-m" else (words[1], words[2:])
    monkeypatch.setattr(sys, "argv", [named, *arguments])
    try:
        if words[1] == "-m":
            monkeypatch.delitem(sys.modules, named, raising=False)  # or a warning says that it is loaded already
            runpy.run_module(named, run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(named, run_name="__main__")
    except SystemExit as end:
        assert not end.code, f"{' '.join(words)} ends with {end.code}"
    except ModuleNotFoundError as missing:
        if Path(named).parent.name != "clients":
            raise
        pytest.skip(f"{missing.name} is not installed here; `make clients` tries it in an environment of its own")


def few_people(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let few people take part in every task, in one draw."""
    for name, task in list(TASKS.items()):
        monkeypatch.setitem(TASKS, name, replace(task, people=FEW, runs=1))


def evaluate_nothing(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Let an evaluation end where its runs would begin: options are checked, policies made, places drawn by then.

    Returns what was to be evaluated, which grows.
    """
    found: list[object] = []

    def reached(*crowds: object, **options: object) -> None:
        found.append(crowds)
        raise SystemExit

    monkeypatch.setattr(same_draws, "evaluate_crowds", reached)
    return found


def short_trainings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a training be over as soon as it begins; tests/agents trains.

    What comes before it is done: libraries are looked for, options are checked, the folder is made.
    """
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: pip install '.[train]'")
    from crowd_env.agents.learned import algorithms
    from crowd_env.agents.learned.curve import CURVE_COLUMNS

    def trained(folder: Path, config: dict, threads: int = 1, runners: int | None = None) -> bool:
        write_csv(folder / "learning_curve.csv", CURVE_COLUMNS, [[0.0] * len(CURVE_COLUMNS)])
        return True

    def learned(config: dict, watch: object) -> None:
        watch.seconds, watch.checkpoints = 1e-9, 1e9  # always due
        for steps in range(2):
            watch.on_update(steps, ShortestPath)

    monkeypatch.setattr(algorithms, "TRAIN", dict.fromkeys(ALGORITHMS, learned))

    for backend in learn.BACKENDS:
        monkeypatch.setitem(learn.BACKENDS, backend, trained)
    monkeypatch.setattr(learn, "check_cluster", lambda: None)
    monkeypatch.setattr(learn, "judge_in_plans", lambda *arguments: "")
    monkeypatch.setattr(learn, "judge", lambda *arguments, **options: {})
    monkeypatch.setattr(learn, "tables", lambda config, results: ())
    monkeypatch.setattr(learn, "draw", lambda folder, config, results: None)


def measure_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every benchmark be one figure, made up; tests/benchmarks tries each."""
    for case in benchmarks.cli.CASES:
        monkeypatch.setitem(benchmarks.cli.CASES, case, lambda effort: [Row("a, 5 people", "speed, 1/s", 2.0)])
    monkeypatch.setattr(benchmarks.cli, "write_table", lambda *words: None)
    monkeypatch.setattr(benchmarks.cli, "fill_pages", lambda: [])
    monkeypatch.setattr(validation.cli, "make", lambda names, source: None)  # a map takes minutes
    monkeypatch.setattr(validation.cli, "fill_pages", lambda: [])


def run_shell(line: str) -> str:
    """Run a line of a shell as it stands."""
    options = {"check": True, "capture_output": True, "text": True}
    return subprocess.run(["sh", "-c", line], **options).stdout


def check_ray(words: list[str]) -> None:
    """Check the words only: tests/core/executors/test_cluster.py starts a cluster, of processes of this machine."""
    options = [word for word in words if word.startswith("--")]
    assert words[1] == "start" and set(options) <= {"--head", "--port", "--address"}
    assert "--head" not in options or "--address" not in options


def check_export(words: list[str]) -> None:
    """Set a variable that a program reads: Ray does this one itself."""
    (setting,) = words[1:]
    assert re.fullmatch(r"RAY_ADDRESS=\d+(\.\d+){3}:\d+", setting)


def attempt(command: Command, monkeypatch: pytest.MonkeyPatch) -> str:
    """Try a command in the working folder; return what it printed, "" where it is known to print nothing that is shown.

    Raises
    ------
    AssertionError, SystemExit, ...
        If the command is wrong, or of a program that nothing here knows how to try.
    """
    words, name = command.words, command.words[0]
    in_environment = re.fullmatch(r"([\w.-]+)/bin/(python|pip)", name)
    if in_environment:
        assert os.path.exists(name), f"{name} was not made by a command above"
        name = in_environment[2]
    tried: dict[str, Callable[[], str | None]] = {
        "crowd-env": lambda: run_crowd_env(words, monkeypatch),
        "python": lambda: run_python(words, monkeypatch),
        "python3": lambda: run_python(words, monkeypatch),
        "make": lambda: check_make(words),
        "pip": lambda: check_pip(words),
        "ray": lambda: check_ray(words),
        "export": lambda: check_export(words),
        "cat": lambda: run_shell(command.line),
        "grep": lambda: run_shell(command.line),
        ".": lambda: run_shell(command.line),
    }
    assert name in tried, f"no test knows how to try {command.line!r}; known programs: {', '.join(tried)}"
    return tried[name]() or ""
