"""Routes, control rules and regions for the compiled step: each pedestrian's route, and its desired speed.

A route is a row of travel-time fields that an environment may offer; each pedestrian has one (`CrowdState.route`).  A rule
counts the people in a region.  While it is on, people elsewhere with that region on their way follow another route (Pécol et
al. 2011, section 4.3).  A region may set or scale the desired speed: stairs.
"""

from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Ints
from crowd_env.core.kernels.jit import inner_kernel
from crowd_env.geometry.surface import Surface, ground_of
from crowd_env.routing.fields.lookup import FieldArrays

MOST_REGIONS = 62  # bits of a mask


class RegionArrays(NamedTuple):
    """Named regions of G geometries on a fine grid, one behind the other; geometry ``g`` without any has the shape (0, 0)."""

    node_start: Ints  # (G+1,)
    shape: Ints  # (G, 2)  rows (y), columns (x)
    origin: Floats  # (G, 2)  m   lower left corner of cell [0, 0]
    spacing: Floats  # (G,)    m
    mask: Ints  # (M,)    bit k: the middle of the cell lies in region k
    fixed: Floats  # (G, 62)  m/s  desired speed there; nan = the pedestrian's
    factor: Floats  # (G, 62)  multiple of the pedestrian's


class RuleArrays(NamedTuple):
    """Control rules of G geometries, one behind the other."""

    start: Ints  # (G+1,)
    region: Ints  # (K,)  where people are counted
    at_least: Ints  # (K,)  switched on by this number
    below: Ints  # (K,)  switched off by fewer than this number
    hold: Floats  # (K,)  s   stays on at least for this time
    route: Ints  # (K,)  route of the others meanwhile
    commits: Bools  # (K,)  people keep to the route after the rule is off


class Guidance(NamedTuple):
    """All that steers people except their own decisions."""

    field_of_route: Ints  # (E, R)  row of `FieldArrays`; -1 = no such route
    goal: Ints  # (E, R)  region that a route leads to; -1 = exits
    following: Ints  # (E, R)  route that takes over there; -1 = none
    until: Floats  # (E, R)  s  time until which people wait at the goal
    region: RegionArrays
    rule: RuleArrays


@inner_kernel
def notice_regions(
    e: int, g: int, region: RegionArrays, surface: Surface, bodies: Bodies, state: CrowdState, history: Any
) -> None:
    """Write each pedestrian's regions (bits) and its desired speed there [m/s] into the `History` of a step."""
    region_bits, local_speed = history.region_bits, history.local_speed
    rows, cols, mask, fixed, factor = region.shape[g, 0], region.shape[g, 1], region.mask, region.fixed, region.factor
    start, left, bottom, spacing = region.node_start[g], region.origin[g, 0], region.origin[g, 1], region.spacing[g]
    active, position, desired_speed = state.active, state.position, bodies.desired_speed
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        local_speed[i] = desired_speed[i]
        region_bits[i] = 0
        if cols == 0 or not active[i]:
            continue
        ox, oy, _, _ = ground_of(surface, g, state.sheet[i])
        column = int(np.floor((position[i, 0] - (left - ox)) / spacing))
        row = int(np.floor((position[i, 1] - (bottom - oy)) / spacing))
        bits = mask[start + min(max(row, 0), rows - 1) * cols + min(max(column, 0), cols - 1)]
        region_bits[i] = bits
        k = 0
        while bits:
            if bits & 1:
                if fixed[g, k] >= 0.0:  # false for nan
                    local_speed[i] = fixed[g, k]
                local_speed[i] *= factor[g, k]
            bits >>= 1
            k += 1


@inner_kernel
def apply_rules(
    e: int,
    g: int,
    field: FieldArrays,
    guidance: Guidance,
    bodies: Bodies,
    state: CrowdState,
    history: Any,
) -> None:
    """Switch the rules of environment ``e`` on and off, and write the present route of each pedestrian, into the history."""
    region_bits, followed = history.region_bits, history.followed
    rule_on, rule_since = history.rule_on, history.rule_since
    rule, slot_begin, slot_end, time = guidance.rule, bodies.env_start[e], bodies.env_start[e + 1], state.time[e]
    active, position, own, field_of_route = state.active, state.position, state.route, guidance.field_of_route
    rule_begin, rule_end = rule.start[g], rule.start[g + 1]
    any_on = False
    for k in range(rule_begin, rule_end):
        count = 0
        for i in range(slot_begin, slot_end):
            if active[i]:
                count += (region_bits[i] >> rule.region[k]) & 1
        on = rule_on[e, k - rule_begin]
        if not on and count >= rule.at_least[k]:
            rule_on[e, k - rule_begin], rule_since[e, k - rule_begin] = True, time
        elif on and count < rule.below[k] and time - rule_since[e, k - rule_begin] >= rule.hold[k]:
            rule_on[e, k - rule_begin] = False
        any_on |= rule_on[e, k - rule_begin]
    for i in range(slot_begin, slot_end):
        if not active[i]:
            continue
        if len(history.stay) > 0 and _waits(e, i, guidance, own[i], region_bits[i], time, history):
            followed[i] = own[i]
            continue
        route = _after_goals(e, guidance, own[i], region_bits[i])
        own[i] = route
        if any_on:
            f = field_of_route[e, route] + state.sheet[i]
            through = regions_ahead(field, f, position[i, 0], position[i, 1])
            for k in range(rule_begin, rule_end):
                bit = 1 << rule.region[k]
                if rule_on[e, k - rule_begin] and through & bit and not region_bits[i] & bit:
                    route = _after_goals(e, guidance, rule.route[k], region_bits[i])
                    if rule.commits[k]:
                        own[i] = route
                    break
        followed[i] = route


@inner_kernel
def _after_goals(e: int, guidance: Guidance, route: int, region_bits: int) -> int:
    """Return the route to follow from a pedestrian's regions: the next one, if the goal of this one is reached."""
    for _ in range(guidance.goal.shape[1]):
        goal = guidance.goal[e, route]
        if goal < 0 or not (region_bits >> goal) & 1 or guidance.following[e, route] < 0:
            break
        route = guidance.following[e, route]
    return route


@inner_kernel
def _waits(e: int, i: int, guidance: Guidance, route: int, region_bits: int, time: float, history: Any) -> bool:
    """Whether pedestrian ``i`` waits at the goal of its route; the time of its arrival there is noted."""
    goal, arrived = guidance.goal[e, route], history.arrived
    history.waits[i] = False
    if goal < 0 or not (region_bits >> goal) & 1:
        return False
    if arrived[i] < 0.0:
        arrived[i] = time
    history.waits[i] = time < max(arrived[i] + history.stay[i], guidance.until[e, route]) - 1e-9
    return bool(history.waits[i])


@inner_kernel
def regions_ahead(field: FieldArrays, f: int, x: float, y: float) -> int:
    """Return the regions (bits) that the way from (x, y) by field ``f`` leads through."""
    if f < 0 or field.shape[f, 1] == 0:
        return 0
    rows, cols = field.shape[f, 0], field.shape[f, 1]
    column = int(np.floor((x - field.origin[f, 0]) / field.spacing[f] + 0.5))
    row = int(np.floor((y - field.origin[f, 1]) / field.spacing[f] + 0.5))
    return field.through[field.node_start[f] + min(max(row, 0), rows - 1) * cols + min(max(column, 0), cols - 1)]
