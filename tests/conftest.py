"""What every test process needs before a library is imported: no window, and no fight over the cores.

The workers of pytest-xdist and the programs that tests start inherit these settings.
"""

import os
import pickle
import sys
import warnings
from functools import wraps

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


@pytest.fixture(scope="session", autouse=True)
def fields_of_a_place_are_made_once():
    """Give equal places one travel-time field: half of what tests of environments took went into making it anew.

    Tests of the fields call `travel_time_field` by its own name, and get a new one each time.
    """
    from crowd_env.physics.simulation import arguments
    from crowd_env.routing import route_set
    from crowd_env.routing.fields.field import travel_time_field

    known = {}

    @wraps(travel_time_field)
    def once(*place, **options):
        try:
            key = pickle.dumps((place, options))
        except (AttributeError, TypeError, pickle.PicklingError):  # a speed that is a function of a test
            return travel_time_field(*place, **options)
        if key not in known:
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                field = travel_time_field(*place, **options)
            if said:  # each time
                return travel_time_field(*place, **options)
            known[key] = field
            if len(known) > 300:
                del known[next(iter(known))]
        known[key] = known.pop(key)  # the last to go
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arguments, "travel_time_field", once)
        patch.setattr(route_set, "_field_of", once)
        yield
