"""The contacts of one environment as a table, for callers."""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.physics.contacts import Contacts
from crowd_env.physics.spatial_order import SortedCrowd


class ContactList(NamedTuple):
    """Contacts of one environment at the start of its last physics step (hertz: at its end), and the impulses of that step."""

    i: Ints  # (C,)    person, counted within the environment
    j: Ints  # (C,)    other person > i, or -1 - k: wall feature k
    gap: Floats  # (C,)    m, < 0 is overlap
    normal: Floats  # (C, 2)  unit vector from j to i
    impulse: Floats  # (C, 2)  N s, normal and tangential
    converged: bool  # whether every solve of the episode so far met its tolerance
    disc_i: Ints | None = None  # (C,)    with an outline: which disc of i
    disc_j: Ints | None = None  # (C,)    which disc of j, -1 of a wall


def list_contacts(
    contacts: Contacts, rows: slice, first: int, order: SortedCrowd | None, converged: bool
) -> ContactList:
    """Return a copy of the contacts ``rows`` of an environment whose first person is ``first``."""
    i, j, normal = contacts.i[rows], contacts.j[rows], contacts.normal[rows]
    disc_i, disc_j = contacts.disc_i[rows], contacts.disc_j[rows]
    places = np.arange(len(i))
    if order is not None:
        i, j, normal, disc_i, disc_j, places = order.by_slot(i, j, normal, disc_i, disc_j)
    has_discs = len(contacts.disc_i) > 0
    return ContactList(
        i - first,
        np.where(j >= 0, j - first, j),
        contacts.gap[rows][places].copy(),
        normal.copy(),
        contacts.impulse[rows][places].copy(),
        converged,
        disc_i.copy() if has_discs else None,
        disc_j.copy() if has_discs else None,
    )
