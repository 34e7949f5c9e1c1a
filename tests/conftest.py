"""What every test process needs before a library is imported: no window, and no fight over the cores.

The workers of pytest-xdist and the programs that tests start inherit these settings.
"""

import gc
import io
import os
import pickle
import sys
import warnings
from dataclasses import fields
from functools import lru_cache, wraps

import pytest

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # torch's own threads; numba's are set where a test is about them
os.environ.setdefault(
    "CROWD_ENV_QUIET", "1"
)  # no note that kernels are being compiled; tests/core/kernels/test_jit.py is about it

# Rewriting the assertions of all tests takes each process ten seconds: what it makes is kept, also where a container says that
# nothing is to be.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def pytest_collection_finish():
    """Leave out of every later search for garbage what lives to the end: a twentieth of all the time went into that."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(5_000, 10, 10)


class _Spelt(pickle.Pickler):
    """Spells a place by its fields, not by what it has found out since."""

    def reducer_override(self, thing):
        if type(thing).__name__ != "Geometry":
            return NotImplemented
        return type(thing), tuple(getattr(thing, field.name) for field in fields(thing))


def _once(make):
    """Return ``make``, which returns what it has made of equal arguments before."""
    known = {}

    @wraps(make)
    def once(*given, **options):
        spelt = io.BytesIO()
        try:
            _Spelt(spelt).dump((given, options))
        except (AttributeError, TypeError, pickle.PicklingError):  # a function of a test, a generator
            return make(*given, **options)
        key = spelt.getvalue()
        if key not in known:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    made = make(*given, **options)
            except Exception:  # what it warns of or refuses is said each time
                return make(*given, **options)
            known[key] = made
            if len(known) > 100:
                del known[next(iter(known))]
        known[key] = known.pop(key)  # the last to go
        return known[key]

    return once


@pytest.fixture(scope="session", autouse=True)
def equal_places_are_made_once():
    """Make equal plans, and the ways in them, once: half of what tests of environments took went into making them anew.

    Tests of the fields call `travel_time_field` by its own name, and get a new one each time.
    """
    from crowd_env import Geometry
    from crowd_env.physics.simulation import arguments, simulation
    from crowd_env.routing.route_set import RoutePlan

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arguments, "travel_time_field", _once(arguments.travel_time_field))
        patch.setattr(simulation, "make_wall_grid", _once(simulation.make_wall_grid))
        patch.setattr(simulation, "border_of", _once(simulation.border_of))
        patch.setattr(RoutePlan, "build", _once(RoutePlan.build))
        patch.setattr(Geometry, "with_apron", lru_cache(300)(Geometry.with_apron))
        patch.setattr(Geometry, "from_polygon", staticmethod(_once(Geometry.from_polygon)))
        yield
