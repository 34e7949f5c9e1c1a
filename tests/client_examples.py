"""The examples for other libraries, in examples/clients, as modules that tests can call."""

import importlib.util
import sys
from types import ModuleType

import pytest
from repository import ROOT

FOLDER = ROOT / "examples" / "clients"


def client_example(client: str, *libraries: str) -> ModuleType:
    """Return the example of a client; without the libraries that it needs, the tests of the module that asks are skipped."""
    for library in reversed(libraries):  # the rarest stands last, and torch takes seconds to load
        where = f"`make clients ARGS={client}` tests it in an environment of its own"
        pytest.importorskip(library, reason=f"{library} is not installed here; {where}")
    (path,) = FOLDER.glob(f"{client}*.py")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # so that what it defines can be pickled
    spec.loader.exec_module(module)
    return module
