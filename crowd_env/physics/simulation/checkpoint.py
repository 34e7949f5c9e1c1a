"""Checkpoints: copies of all that the future of a simulation depends on, to restore here or in another process."""

from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, CrowdState, Floats, Ints
from crowd_env.core.checks import shown
from crowd_env.core.kernels.struct_ref import StructRef
from crowd_env.physics.contacts import Contacts, of_a_contact, rows_of
from crowd_env.physics.neighbors.lists import NeighborList, invalidate_lists
from crowd_env.physics.simulation.entrances import EntryState
from crowd_env.physics.spatial_order import Order
from crowd_env.physics.workspace import Diagnostics, History, Results, Workspace
from crowd_env.routing.door_schedule import DoorState
from crowd_env.routing.replanning import PlannerState

Arrays = dict[str, Any]  # arrays by name, and nested tables of arrays


class SavedHistory(NamedTuple):
    """A copy of a `History`."""

    arrays: Arrays  # by name
    contacts: Ints  # (E,)  how many in each environment
    of_contacts: Arrays  # by name, all environments concatenated


class Checkpoint(NamedTuple):
    """A moment of a `Simulation`; made by `Simulation.checkpoint`, restored by `Simulation.restore`.  It can be pickled."""

    made_by: dict[str, Any]  # what a simulation must have in common with the source of the checkpoint
    bodies: Bodies
    state: CrowdState
    history: SavedHistory
    results: Results  # of the last call
    diagnostics: Diagnostics  # of the episodes so far
    doors: DoorState
    route_set: PlannerState
    order: Order | None  # None = no crowd is large
    escaped: np.ndarray  # (P,)  found outside of the walkable area
    entries: EntryState
    gates: tuple[Floats, Floats]  # when each may admit the next (E, G) [s], and is looked at (E,) [s]


def copy_arrays(fields: Any) -> Arrays:
    """Return copies of the arrays of a NamedTuple and of nested tuples, by name; references are left out."""
    named = {
        name: value for name, value in zip(fields._fields, fields, strict=True) if not isinstance(value, StructRef)
    }
    found: Arrays = {name: value.copy() for name, value in named.items() if isinstance(value, np.ndarray)}
    return found | {name: copy_arrays(value) for name, value in named.items() if isinstance(value, tuple)}


def write_arrays(fields: Any, arrays: Any) -> None:
    """Write copied arrays back in place, nested ones too, so that all holders of the arrays see them."""
    for name, then in (arrays if isinstance(arrays, dict) else arrays._asdict()).items():
        if isinstance(then, np.ndarray):
            getattr(fields, name)[...] = then
        else:
            write_arrays(getattr(fields, name), then)


def save_history(history: History, neighbors: NeighborList) -> SavedHistory:
    """Return a copy of the history."""
    contacts, rows = history.contacts, _rows_of_all(history.contacts, neighbors)
    of_contacts = {name: getattr(contacts, name)[rows] for name in of_a_contact(contacts)}
    return SavedHistory(copy_arrays(history), contacts.number.copy(), of_contacts)


def load_history(history: History, workspace: Workspace, then: SavedHistory) -> None:
    """Write a copy of the history back in place; the next step rebuilds the neighbor lists."""
    write_arrays(history, then.arrays)
    contacts = history.contacts
    contacts.number[:] = then.contacts
    rows = _rows_of_all(contacts, workspace.neighbors)
    for name, array in then.of_contacts.items():
        getattr(contacts, name)[rows] = array
    invalidate_lists(workspace.neighbors)


def _rows_of_all(contacts: Contacts, neighbors: NeighborList) -> Ints:
    """Return the rows of the contacts of all environments."""
    rows = [rows_of(e, contacts, neighbors) for e in range(len(contacts.number))]
    return np.concatenate([np.arange(row.start, row.stop) for row in rows])


def require_checkpoint(checkpoint: Any, kind: type, of: str) -> None:
    """Raise TypeError unless a checkpoint is of class ``kind``."""
    if not isinstance(checkpoint, kind):
        raise TypeError(f"restore takes a checkpoint() of {of}, not {type(checkpoint).__name__}")


def require_same(now: dict[str, Any], then: dict[str, Any], of: str = "simulation") -> None:
    """Raise ValueError if two simulations or environments differ in what they must have in common, naming it."""
    for name in {**now, **then}:
        if now.get(name) != then.get(name):
            says = "" if name in ("place", "routing") else f": {shown(then.get(name))}, here {shown(now.get(name))}"
            raise ValueError(f"the checkpoint fits another {of}: its {name} differs{says}")
