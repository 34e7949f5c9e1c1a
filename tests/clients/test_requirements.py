"""Each client has an example, its requirements, a test, and a row in the documentation."""

import re

import pytest
from client_examples import FOLDER
from packaging.requirements import Requirement
from repository import ROOT

CLIENTS = sorted(path.stem for path in FOLDER.glob("*.txt"))


def requirements(client):
    lines = (FOLDER / f"{client}.txt").read_text(encoding="utf-8").splitlines()
    return [Requirement(line) for line in lines if line and line[0] not in "#-"]


def test_every_example_is_tested_and_every_test_has_an_example():
    tests = {path.stem.removeprefix("test_") for path in (ROOT / "tests" / "clients").glob("test_*.py")}
    assert set(CLIENTS) == tests - {"requirements"}
    assert sorted(path.stem.partition("_")[0] for path in FOLDER.glob("*.py")) == CLIENTS


@pytest.mark.parametrize("client", CLIENTS)
def test_the_documentation_shows_its_example(client):
    (example,) = FOLDER.glob(f"{client}*.py")
    rows = (ROOT / "docs" / "clients.md").read_text(encoding="utf-8").splitlines()
    link = f"[{example.name}](../examples/clients/{example.name})"
    assert [row for row in rows if row.startswith("|") and link in row]


@pytest.mark.parametrize("client", CLIENTS)
def test_versions_are_those_that_were_tried(client):
    """Exact ones, from no place in particular, and of torch one with a small build for machines without a GPU."""
    for requirement in requirements(client):
        assert re.fullmatch(r"==[\d.]+", str(requirement.specifier)) and requirement.url is None, requirement
        if requirement.name == "torch":
            assert not requirement.specifier.contains("2.14.0")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_hides_no_library(path):
    """Run by its path, an example sees its own folder first: `torchrl.py` would be imported as the library of that name."""
    assert path.stem not in {requirement.name for client in CLIENTS for requirement in requirements(client)}
    text = path.read_text(encoding="utf-8")
    assert f"python examples/clients/{path.name}" in text and 'if __name__ == "__main__":' in text
