"""The contact list: every contact of disc and disc, wall or corner, as one struct of arrays.

Bodies with an outline have several discs, so two bodies, or a body and a wall feature, may have several contacts.

Sign conventions: ``gap`` is the distance between the surfaces (negative = overlap); the unit ``normal`` points from ``j`` to
``i``, so a positive normal impulse pushes ``i`` along ``+normal`` and ``j`` along ``-normal``; the tangent is the normal turned
left by 90 degrees.  ``j < 0`` is a wall feature: it does not move.  `crowd_env.physics.narrow_phase` finds them.
"""

from typing import Annotated, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.kernels.jit import inner_kernel
from crowd_env.physics.neighbors.lists import NeighborList


class Contacts(NamedTuple):
    """Contacts of all environments; ``e`` owns ``NeighborList.entry_start[e]`` onwards, ``number[e]`` of them."""

    number: Annotated[Ints, "E"]
    i: Annotated[Ints, "M"]  # global person
    j: Annotated[Ints, "M"]  # global person > i, or -1 - k: wall feature k
    gap: Annotated[Floats, "M"]  # m     < 0 is overlap
    normal: Annotated[Floats, "M 2"]  # unit, from j to i
    impulse: Annotated[Floats, "M 2"]  # N s   normal, tangential, of the current step
    history: Annotated[Floats, "M 2"]  # memory of the scheme while a contact lasts; 0 at first
    # nsm1, nsm2: normal impulses [N s], warm start of the next step and last step; hertz: tangential elongation [m], 0
    # Which disc of i; this array and the next are empty without an outline.
    disc_i: Annotated[Ints, "M", "discs"]
    disc_j: Annotated[Ints, "M", "discs"]  # which disc of j; -1 of a wall


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


def of_a_contact(contacts: Contacts) -> list[str]:
    """Return the names of the arrays with one row a contact; others have one row an environment, or are empty."""
    return [name for name in Contacts._fields[1:] if len(getattr(contacts, name))]


def rows_of(e: int, contacts: Contacts, near: NeighborList) -> slice:
    """Return where the contacts of environment ``e`` are."""
    first = int(near.entry_start[e])
    return slice(first, first + int(contacts.number[e]))


def move_contacts(old: Contacts, old_near: NeighborList, new: Contacts, new_near: NeighborList) -> None:
    """Copy the contacts of every environment to their place in longer arrays."""
    new.number[:] = old.number
    for e in range(len(old.number)):
        source, target = rows_of(e, old, old_near), rows_of(e, new, new_near)
        for name in of_a_contact(new):
            getattr(new, name)[target] = getattr(old, name)[source]


@inner_kernel
def contact_key(i: int, j: int) -> int:
    """Return a number that orders contacts by (i, j), walls last."""
    return (i << 32) + (j if j >= 0 else (1 << 31) - 1 - j)


@inner_kernel
def contact_of_key(key: int) -> tuple[int, int]:
    """Return the (i, j) of a number of `contact_key`."""
    i = key >> 32
    j = key - (i << 32)
    return i, (j if j < (1 << 31) else (1 << 31) - 1 - j)


def order_of_contacts(i: Ints, j: Ints, disc_i: Ints, disc_j: Ints) -> Ints:
    """Return the order (C,) of contacts by (i, j, discs), walls last; without an outline by (i, j)."""
    keys = (i << 32) + np.where(j >= 0, j, (1 << 31) - 1 - j)  # see `contact_key`
    return np.argsort(keys) if not len(disc_i) else np.lexsort((disc_j, disc_i, keys))
