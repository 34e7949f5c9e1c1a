"""Execute the notebooks of this folder and keep their outputs in them: ``make notebooks``, ``make notebooks ARGS=pedpy``.

Only what follows from the sources is kept, so that a second execution on the same machine changes no byte.
"""

import asyncio
import hashlib
import itertools
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from nbformat import NotebookNode

from crowd_env.core.files.atomic import write_text

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LONGEST = 1800  # s, of a cell: the kernels of several schemes may have to be compiled first
SPENT = re.compile(r"^ *(\S.*); [\d.]+ s of computing *$", re.MULTILINE)  # centered, below the table of crowd-env run
# Of any Python 3: which one ran is no news.
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python", "pygments_lexer": "ipython3"},
}


def digest(notebook: NotebookNode) -> str:
    """Return a text that changes whenever the source of a code cell does."""
    sources = "\n\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    return hashlib.sha256(sources.encode()).hexdigest()[:16]


def execute(path: Path) -> NotebookNode:
    """Return a notebook with the outputs of a new execution, in a folder of its own that goes away: nothing else is written.

    The kernel is the Python that runs this, whether its environment is activated or not, with the packages of this checkout.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        If a cell fails; the message shows the cell and its error.
    """
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        here = folder / FOLDER.relative_to(ROOT)
        here.mkdir(parents=True)
        shutil.copytree(ROOT / "examples", folder / "examples", ignore=shutil.ignore_patterns("__pycache__"))
        specs = KernelSpecManager(kernel_dirs=[], ensure_native_kernel=True)
        manager: Any = AsyncKernelManager(kernel_spec_manager=specs, transport="ipc", ip=str(folder / "kernel"))
        manager.connection_file = str(folder / "kernel.json")
        client = NotebookClient(notebook, km=manager, timeout=LONGEST, resources={"metadata": {"path": str(here)}})
        asyncio.run(client.async_execute(env=environment(folder), cleanup_kc=True))
    return tidied(notebook)


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of a kernel that keeps its files in a folder."""
    own = {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)]),
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
        "IPYTHONDIR": str(folder / "ipython"),
        "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        "COLUMNS": "88",  # of tables
        "OMP_NUM_THREADS": "1",
        "CROWD_ENV_QUIET": "1",  # no note that kernels are being compiled
    }
    return os.environ | own


def tidied(notebook: NotebookNode) -> NotebookNode:
    """Return an executed notebook without what differs from one execution to the next, and with the digest of its sources."""
    for cell in notebook.cells:
        cell.metadata = {name: cell.metadata[name] for name in ("tags",) if name in cell.metadata}
        if cell.cell_type == "code":
            cell.outputs = _joined(cell.outputs)
    notebook.metadata = nbformat.from_dict(METADATA | {"crowd_env": {"sources": digest(notebook)}})
    return notebook


def _joined(outputs: list[NotebookNode]) -> list[NotebookNode]:
    """Return outputs of which those to a stream are one until something else comes: how they are cut depends on the time.

    Of a command's two streams the errors come last.
    """
    found: list[NotebookNode] = []
    for _, group in itertools.groupby(outputs, lambda output: output.output_type == "stream"):
        several = list(group)
        if several[0].output_type != "stream":
            found += several
            continue
        for name in sorted({output.name for output in several}, reverse=True):
            text = "".join(output.text for output in several if output.name == name)
            found.append(nbformat.v4.new_output("stream", name=name, text=SPENT.sub(r"\1", text)))
    return found


def main(names: list[str]) -> None:
    """Execute the notebooks of these names, by default all, and write those that ran."""
    known = {path.stem: path for path in NOTEBOOKS}
    for name in names:
        if name not in known:
            raise SystemExit(f"there is no notebook {name!r}; known: {', '.join(known)}")
    for name in names or known:
        try:
            notebook = execute(known[name])
        except CellExecutionError as error:
            raise SystemExit(f"{known[name]} is left as it was: a cell fails\n\n{error}") from None
        write_text(known[name], nbformat.writes(notebook) + "\n")
        print(f"{known[name].relative_to(ROOT)}: {known[name].stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
