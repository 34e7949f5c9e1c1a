"""Every Python block of the pages runs, and so does every example."""

import re

import pytest
from repository import ROOT
from shown import blocks, tried

from crowd_env import CrowdEnv
from crowd_env.core.files.own import load_own


@pytest.mark.parametrize("block", tried("python"))
def test_python_blocks_run(block, monkeypatch, tmp_path):
    for library in set(re.findall(r"^import (pandas|pedpy)", block.text, re.MULTILINE)):
        pytest.importorskip(library, reason=f"{library} is not installed; `make test` does")
    monkeypatch.chdir(tmp_path)
    exec(compile("\n" * block.line + block.text, str(block.page), "exec"), {"__name__": "__main__"})


def test_the_readme_has_a_short_example_to_begin_with():
    block = blocks("python")[0]
    assert block.page.name == "README.md"
    assert block.line < 60
    assert len(block.text.splitlines()) <= 12


@pytest.mark.more
@pytest.mark.parametrize("name", ["own_policy", "shipped_policy"])
def test_examples_run(name, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    example = __import__(f"examples.{name}", fromlist=["main"])
    if name == "own_policy":
        example.main(runs=1)
    else:
        from crowd_env.agents import load
        from crowd_env.agents.evaluation.evaluation import evaluate
        from crowd_env.agents.tasks import make_task

        task = make_task("competitive-door")
        judged = evaluate(load("competitive-door/ppo"), task.place(8), runs=1, **task.arguments())
        assert example.main(people=8) == judged.column("evacuation_time")[0]


@pytest.mark.more
def test_a_law_of_your_own_leads_people_out():
    law = load_own("--scheme", f"{ROOT / 'examples' / 'my_law.py'}:MyLaw")
    env = CrowdEnv("room-v0", people=10, physics=law)
    env.reset(seed=0)
    while not env.finished.all():
        env.step(None)
    metrics = env.metrics(0)
    assert metrics.unfinished == metrics.escaped == 0 and metrics.max_overlap < law.overlap_bound(
        env.simulation.bodies, 0.01
    )
