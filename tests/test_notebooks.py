"""The notebooks of docs/notebooks/ run, and the outputs that are kept in them are those of their sources.

They are executed here; the site shows the outputs as they are kept.  `make test` installs what they need.
"""

import copy
import json
import re
import subprocess
import sys

import pytest
from repository import ROOT

nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed; `make test` does")
pytest.importorskip("nbclient", reason="nbclient is not installed; `make test` does")
pytest.importorskip("ipykernel", reason="ipykernel is not installed; `make test` does")

from docs.notebooks.execute import NOTEBOOKS, digest, execute, tidied  # noqa: E402

LARGEST = 400_000  # bytes: code hosts show no larger ones, and every execution is a new version
# Folders of a machine, addresses in memory, and warnings: nobody else has them.
OF_A_MACHINE = re.compile(
    r"(?<![\w.])/(?:Users|home|opt|private|root|tmp|usr|var|work)/|0x[0-9a-f]{6,}|Warning|\x1b|s of computing"
)
pytestmark = pytest.mark.more
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def text_of(cell):
    """Return what a cell has put out, but for pictures."""
    found = []
    for output in cell.outputs:
        found += [output.get("text", "")]
        found += [str(value) for kind, value in output.get("data", {}).items() if not kind.startswith("image/")]
    return "\n".join(found)


@pytest.mark.nightly
@each_notebook
def test_a_notebook_runs(path):
    if "import pedpy" in path.read_text(encoding="utf-8"):
        pytest.importorskip("pedpy", reason="PedPy is not installed; `make test` does")
    before = path.read_bytes()
    notebook = execute(path)
    assert [cell.execution_count for cell in code_cells(notebook)] == list(range(1, len(code_cells(notebook)) + 1))
    assert path.read_bytes() == before
    kept = nbformat.reads(before.decode(), as_version=4)
    pairs = zip(code_cells(kept), code_cells(notebook), strict=True)
    stale = [cell.source for cell, now in pairs if text_of(cell) != text_of(now)]
    assert not stale, f"run: make notebooks ARGS={path.stem}"


@each_notebook
def test_the_outputs_that_are_kept_are_those_of_the_sources(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert notebook.metadata.crowd_env.sources == digest(notebook), f"run: make notebooks ARGS={path.stem}"
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert not [cell.source for cell in cells if any(output.output_type == "error" for output in cell.outputs)]
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.outputs)
    found = [(cell.source, OF_A_MACHINE.findall(text_of(cell))) for cell in cells]
    assert not [one for one in found if one[1]]
    assert len(path.read_bytes()) < LARGEST


@each_notebook
def test_a_notebook_is_kept_as_it_is_tidied(path):
    notebook = nbformat.read(path, as_version=4)
    assert nbformat.writes(tidied(copy.deepcopy(notebook))) == nbformat.writes(notebook)


@each_notebook
def test_links_lead_somewhere(path):
    text = "\n".join(cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "markdown")
    links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if "://" not in link]
    assert links
    assert not [link for link in links if not (path.parent / link).exists()]


def test_another_source_has_another_digest():
    notebook = nbformat.read(NOTEBOOKS[0], as_version=4)
    before = digest(notebook)
    notebook.cells[0].source += " and more words"
    assert digest(notebook) == before
    code_cells(notebook)[-1].source += "\n"
    assert digest(notebook) != before


def test_what_differs_between_executions_is_not_kept():
    new = nbformat.v4
    outputs = [
        new.new_output("stream", name="stderr", text="note\n"),
        new.new_output("stream", name="stdout", text="  seed 0; 0."),
        new.new_output("stream", name="stdout", text="7 s of computing  \n"),
        new.new_output("display_data", {"text/plain": "1"}),
        new.new_output("stream", name="stdout", text="end\n"),
    ]
    cell = new.new_code_cell("run()", outputs=outputs, execution_count=1, metadata={"execution": {"iopub": "now"}})
    notebook = tidied(
        new.new_notebook(cells=[cell], metadata={"language_info": {"name": "python", "version": "3.11.7"}})
    )
    assert [output.get("text") for output in cell.outputs] == ["seed 0\n", "note\n", None, "end\n"]
    assert cell.metadata == {}
    assert "3.11.7" not in json.dumps(notebook)


def test_a_cell_that_fails_is_shown_and_nothing_is_written(tmp_path):
    new = nbformat.v4
    path = tmp_path / "wrong.ipynb"
    nbformat.write(new.new_notebook(cells=[new.new_code_cell("print('so far')\n1 / 0")]), path)
    before = path.read_bytes()
    from nbclient.exceptions import CellExecutionError

    with pytest.raises(CellExecutionError, match="1 / 0") as error:
        execute(path)
    assert "ZeroDivisionError" in str(error.value)
    assert path.read_bytes() == before


def test_a_notebook_that_there_is_not_is_named():
    command = [sys.executable, "-m", "docs.notebooks.execute", "pedpi"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.startswith("there is no notebook 'pedpi'; known: compare-routing, ")
    assert "Traceback" not in done.stderr
