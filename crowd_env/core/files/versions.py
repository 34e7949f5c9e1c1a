"""Which versions computed something: to be kept beside results."""

import platform
from importlib import metadata

_COMPUTE = ("crowd-env", "numba", "numpy", "scikit-fmm", "shapely")


def versions_of(*packages: str) -> dict[str, str]:
    """Return the versions of Python, the kind of machine, what every simulation computes with, and further packages."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in sorted({*_COMPUTE, *packages}):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
