"""A crowd leaves a room, and learns to leave it better.  One file, to be read from top to bottom.

    python examples/one_file.py

A room, the shortest way to its door, the people in it, two laws of contact, one step, what a pedestrian sees, what it is paid,
and how it learns.  It needs numpy, a compiler (numba) and, for the learning at the end, torch.
The package `crowd_env` computes the same, and much more; `tests/examples/test_one_file.py` holds the two together.

A pedestrian i is a disc with position q_i [m], velocity u_i [m/s], radius r_i [m] and mass m_i [kg].  It wants to walk with the
speed v_i along the unit vector e_i.  The physics step is h [s].  Equations, tables and sections are numbered as in

    P. Pécol, S. Dal Pont, S. Erlicher, P. Argoul, Discrete approaches for crowd movement modelling,
    European Journal of Computational Mechanics 20 (2011) 189-206.
"""

import sys
import time
from typing import NamedTuple

import numpy as np
from numba import njit

H = 0.01  # s      physics step
STIFFNESS = 1.2e5  # N/m    k of eq 5 (Helbing, Farkas, Vicsek 2000)
DEM, NSM1 = 0, 1  # the two laws of contact


# -------------------------------------------------------------------------------------------- the room, and the shortest way
class Room(NamedTuple):
    """A square with a door in the middle of its right wall, and the shortest way out from the nodes of a grid."""

    wall: np.ndarray  # (5, 2, 2) m  from where to where
    door: np.ndarray  # (2, 2) m
    way: np.ndarray  # (rows, cols, 3)  unit vector along the way out, and its length [m]
    is_straight: np.ndarray  # (rows, cols)  whether it leads to the door in a straight line
    spacing: float  # m  between nodes; the first lies in the corner (0, 0)


def make_room(size: float, width: float, radius: float = 0.25, spacing: float = 0.05) -> Room:
    """Find the shortest way out for the center of a body, which keeps its radius from all walls, by string pulling.

    It is a straight line to the door or, from beside the door, a tangent to the circle around a jamb and an arc of it.
    """
    low, high = (size - width) / 2, (size + width) / 2
    corner = np.array([(size, high), (size, size), (0, size), (0, 0), (size, 0), (size, low)])
    wall, door = np.stack([corner[:-1], corner[1:]], axis=1), corner[[-1, 0]]
    node = spacing * np.stack(np.meshgrid(*2 * [np.arange(round(size / spacing) + 1)]), axis=-1)
    off = np.stack([offset(node, *ends) for ends in wall])  # (5, rows, cols, 2) m  from each wall
    inward = 1e-6 * np.array([(-1, 0), (0, -1), (1, 0), (0, 1), (-1, 0)])[:, None, None]
    off = np.where(np.linalg.norm(off, axis=-1, keepdims=True) < 1e-6, inward, off)  # on the wall itself
    near = np.linalg.norm(off, axis=-1)
    free, way = near.min(axis=0) > radius - 1e-6, np.zeros((*near.shape[1:], 3))
    is_straight = free & (abs(node[..., 1] - size / 2) < width / 2 - radius + 1e-9)
    for i, j in np.argwhere(free):
        way[i, j] = (straight_out if is_straight[i, j] else around_jamb)(door, *node[i, j], radius)
    # Nearer to a wall, the way leads where it does from the nearest free node, if it gets away from the walls at once.  Else
    # it is that of the place a radius away from them, but turned away from them (a choice).
    known, away = np.argwhere(free), (np.maximum(1 - near / radius, 0)[..., None] * unit(off)).sum(axis=0)
    for i, j in np.argwhere(~free):
        nearest = known[np.hypot(*(known - (i, j)).T).argmin()]
        lead = straight_out if is_straight[tuple(nearest)] else around_jamb
        here, turn = np.array(lead(door, *node[i, j], radius)), away[i, j]
        first = min(0.05 * radius, here[2])  # m
        then = np.array([np.linalg.norm(offset(node[i, j] + first * here[:2], *ends)) for ends in wall])
        if (then > np.minimum(near[:, i, j] + 0.25 * first, radius) - 1e-6).all():
            way[i, j], is_straight[i, j] = here, lead is straight_out
        else:
            ex, ey, length = lead(door, *node[i, j] + radius * turn, radius)
            toward = min(ex * turn[0] + ey * turn[1], 0) / (turn @ turn)
            way[i, j] = *unit((ex, ey) + (2 - toward) * turn), length + radius * np.linalg.norm(turn)
    return Room(wall, door, way, is_straight, spacing)


def unit(vector: np.ndarray) -> np.ndarray:
    """Return vectors (..., 2) of the length 1."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def offset(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the vector to a point from the nearest place between a and b; all (..., 2) m."""
    share = ((point - a) * (b - a)).sum(axis=-1) / np.maximum(((b - a) ** 2).sum(axis=-1), 1e-18)
    return point - a - np.clip(share, 0, 1)[..., None] * (b - a)


@njit
def straight_out(door, x, y, radius):
    """Return the unit vector to where a body can pass the door, from the doorstep on out of it, and the length [m]."""
    (size, low), (_, high) = door
    y_passed = min(max(y, low + radius), high - radius) if high - low > 2 * radius else (low + high) / 2
    dx, dy = max(size - x, 0.25 * radius), y_passed - y
    norm = np.sqrt(dx * dx + dy * dy)
    return dx / norm, dy / norm, np.sqrt((size - x) ** 2 + dy * dy)


@njit
def around_jamb(door, x, y, radius):
    """Return the unit vector along the tangent to the circle around the nearer jamb, and the length [m] with the arc."""
    (size, low), (_, high) = door
    side = 1.0 if y > (low + high) / 2 else -1.0  # of the upper jamb; at the lower one all is mirrored
    dx, dy = size - x, side * ((high if side > 0 else low) - y)
    power = dx * dx + dy * dy - radius * radius
    line = np.sqrt(max(power, 0.0)) if power > -1e-6 else np.nan  # from within the circle there is none
    square = line * line + radius * radius
    ex, ey = (dx * line + dy * radius) / square, (dy * line - dx * radius) / square
    return ex, side * ey, line + radius * np.arctan2(-ey, ex)


# ----------------------------------------------------------------------------------------------------------- the people
class Crowd(NamedTuple):
    """N people.  The arrays change in place; a person who is out stays where the door was passed."""

    q: np.ndarray  # (N, 2) m    position
    u: np.ndarray  # (N, 2) m/s  velocity
    radius: np.ndarray  # (N,) m
    mass: np.ndarray  # (N,) kg
    speed: np.ndarray  # (N,) m/s  v, which a person wants to walk with
    tau: np.ndarray  # (N,) s    in which a person gets to that speed
    inside: np.ndarray  # (N,)
    exit_time: np.ndarray  # (N,) s    nan while inside
    impulse: np.ndarray  # (N,) N s  felt in contacts since it was last set to 0
    clock: np.ndarray  # (1,) s


def draw_crowd(room: Room, people: int, rng: np.random.Generator) -> Crowd:
    """Return people of Table 4 at rest, each at a random place that is free (section 4.2)."""
    radius, mass, speed, tau = rng.uniform([[0.2], [60], [1.2], [0.1]], [[0.25], [100], [2.0], [0.5]], (4, people))
    q, size, zeros = np.zeros((people, 2)), room.wall.max(), np.zeros(people)
    for i in range(people):
        while not q[i].any() or (np.linalg.norm(q[:i] - q[i], axis=1) < radius[:i] + radius[i]).any():
            q[i] = rng.uniform(radius[i], size - radius[i], 2)
    return Crowd(q, 0 * q, radius, mass, speed, tau, zeros == 0, zeros + np.nan, zeros, np.zeros(1))


@njit
def ways(room, crowd):
    """Return the unit vector of everyone's way, and its length (N, 3) [m]; zeros for those who are out."""
    (rows, cols), way = room.is_straight.shape, np.zeros((len(crowd.q), 3))
    for n in np.flatnonzero(crowd.inside):
        x, y = crowd.q[n]
        u, v = min(max(x / room.spacing, 0.0), cols - 1.0), min(max(y / room.spacing, 0.0), rows - 1.0)
        i, j = min(int(v), rows - 2), min(int(u), cols - 2)
        if room.is_straight[i : i + 2, j : j + 2].all():
            way[n] = straight_out(room.door, x, y, crowd.radius[n])
            continue
        for p in range(i, i + 2):  # between the four nodes around
            for q in range(j, j + 2):
                for k in range(3):
                    way[n, k] += (1 - abs(v - p)) * (1 - abs(u - q)) * room.way[p, q, k]
        way[n, :2] /= np.sqrt(way[n, 0] ** 2 + way[n, 1] ** 2)
    return way


# ------------------------------------------------------------------------------------------------- two laws of contact
@njit
def find_contacts(room, crowd, reach):
    """Return all who are less than ``reach`` [m] apart: i, j, gap D (eq 2), unit vector n from j to i; a wall is j = -1."""
    contacts = [(0, 0, 0.0, 0.0, 0.0)][:0]  # empty, but the compiler knows what is in it
    for i in np.flatnonzero(crowd.inside):
        x, y, r = crowd.q[i, 0], crowd.q[i, 1], crowd.radius[i]
        for j in range(i + 1, len(crowd.q)):
            if crowd.inside[j]:
                dx, dy, both = x - crowd.q[j, 0], y - crowd.q[j, 1], r + crowd.radius[j]
                if dx * dx + dy * dy < (both + reach) ** 2:
                    apart = np.sqrt(dx * dx + dy * dy)
                    contacts.append((i, j, apart - both, dx / apart, dy / apart))
        for k in range(len(room.wall)):  # the place on a wall that is nearest; at a jamb, its end
            (ax, ay), (bx, by) = room.wall[k]
            share = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
            share = min(max(share, 0.0), 1.0)
            dx, dy = x - ax - share * (bx - ax), y - ay - share * (by - ay)
            if dx * dx + dy * dy < (r + reach) ** 2:
                apart = np.sqrt(dx * dx + dy * dy)
                contacts.append((i, -1, apart - r, dx / apart, dy / apart))
    return contacts


@njit
def soft_discs(crowd, wish, contacts):
    """Give everyone the velocity of the end of the step, by forces: `dem`.

    f = m (v e - u) / tau          the drive, eq 11
    g = -k min(0, D) n             a spring while two overlap, eqs 4 and 5 (as printed it would attract)
    u(n+1) = u(n) + h (f + g) / m  eq 3
    """
    for i in range(len(wish)):
        crowd.u[i] += H * (wish[i] - crowd.u[i]) / crowd.tau[i]
    for i, j, gap, nx, ny in contacts:
        push(crowd, i, j, nx, ny, -H * STIFFNESS * min(0.0, gap))


@njit
def no_overlap(crowd, wish, contacts, tolerance):
    """Give everyone the velocity of the end of the step, by a projection: `nsm1`, after Maury and Venel.

    u(n+1) = argmin sum of m |u - v e|^2 / 2   such that   D + h n . (u_i - u_j) >= 0 for every contact      eq 6

    All walk as they wish, or as near to that as lets nobody overlap; there is no inertia.  One contact after the other pushes
    as hard as it must, and never pulls, until none changes by more than the tolerance [m/s] (projected Gauss-Seidel).
    """
    crowd.u[:] = wish
    pushed, worst = np.zeros(len(contacts)), np.inf  # N s
    while worst > tolerance:
        worst = 0.0
        for c, (i, j, gap, nx, ny) in enumerate(contacts):
            apart, lightness = nx * crowd.u[i, 0] + ny * crowd.u[i, 1], 1 / crowd.mass[i]
            if j >= 0:
                apart -= nx * crowd.u[j, 0] + ny * crowd.u[j, 1]
                lightness += 1 / crowd.mass[j]
            change = max(pushed[c] - (apart + gap / H) / lightness, 0.0) - pushed[c]
            push(crowd, i, j, nx, ny, change)
            pushed[c] += change
            worst = max(worst, abs(change) * lightness)


@njit
def push(crowd, i, j, nx, ny, impulse):
    """Push i and j apart with an impulse [N s]; a wall does not move."""
    for k, sign in ((i, 1.0), (j, -1.0)):
        if k >= 0:
            crowd.u[k, 0] += sign * impulse * nx / crowd.mass[k]
            crowd.u[k, 1] += sign * impulse * ny / crowd.mass[k]
            crowd.impulse[k] += impulse


@njit
def step(room, crowd, share, law, tolerance=1e-3):
    """Advance a crowd by one physics step.  Everyone wants a ``share`` (N,) of the own speed along the shortest way."""
    # Where everyone wants to go.
    wish = np.expand_dims(share * crowd.speed, 1) * ways(room, crowd)[:, :2]
    # Who touches whom, and the velocities that follow from it.
    if law == DEM:
        soft_discs(crowd, wish, find_contacts(room, crowd, 0.0))
    else:
        no_overlap(crowd, wish, find_contacts(room, crowd, 0.2), tolerance)  # also those who could meet in this step
    # Positions: q(n+1) = q(n) + h u(n+1), eq 3.  Those who pass the door are out.  (Walls are as soft as people: in larger
    # crowds the package also keeps centers from being pressed through them.)
    for i in np.flatnonzero(crowd.inside):
        before, size = crowd.q[i, 0], room.door[0, 0]
        crowd.q[i] += H * crowd.u[i]
        if crowd.q[i, 0] > size:
            crowd.inside[i] = False
            crowd.exit_time[i] = crowd.clock[0] + H * (size - before) / (crowd.q[i, 0] - before)
    crowd.clock[0] += H


# ---------------------------------------------------------------------------------- what a pedestrian sees, and is paid
DECISION, SIGHT, SEEN = 10, 3.0, 7  # steps; m; numbers


@njit
def look(room, crowd, seen):
    """Write what everyone sees into ``seen`` (N, SEEN), and return the time to go (N,) [s].

    Oneself: the velocity along the way and to the left of it, the desired speed, the time to go.  Of the people in sight who
    are nearer to the door: how near the next one is, how fast, and how many there are.
    """
    way, inside, seen[:] = ways(room, crowd), np.flatnonzero(crowd.inside), 0.0
    for i in inside:
        (x, y), (u, v), (ex, ey, to_go) = crowd.q[i], crowd.u[i], way[i]
        seen[i, 0], seen[i, 1] = (u * ex + v * ey) / 2, (v * ex - u * ey) / 2
        seen[i, 2], seen[i, 3] = crowd.speed[i] / 2, to_go / (to_go + 5 * crowd.speed[i])
        ahead, least = 0, np.inf
        for j in inside:
            lead = to_go - way[j, 2]
            if lead > 0 and (crowd.q[j, 0] - x) ** 2 + (crowd.q[j, 1] - y) ** 2 < SIGHT**2:
                ahead += 1
                if lead < least:
                    least = lead
                    seen[i, 4] = max(1 - lead / SIGHT, 0)
                    seen[i, 5] = (crowd.u[j, 0] * way[j, 0] + crowd.u[j, 1] * way[j, 1]) / 2
        seen[i, 6] = ahead / (ahead + 10)
    return way[:, 2] / crowd.speed


@njit
def decide(room, crowd, share, law, to_go, seen):
    """Advance a crowd by one decision; write what everyone sees into ``seen``, and return the time to go and the reward (N,).

    The reward is half of the time to go that was saved [s], less the time spent [s], less the impulse felt over the own mass
    [m/s].  The last makes people slow down: without it, pushing costs nothing.
    """
    began, crowd.impulse[:] = crowd.clock[0], 0.0
    for _ in range(DECISION):
        step(room, crowd, share, law)
    left = look(room, crowd, seen)
    spent = np.maximum(np.where(crowd.inside, crowd.clock[0], crowd.exit_time) - began, 0.0)
    return left, 0.5 * (to_go - left) - spent - crowd.impulse / crowd.mass


# ------------------------------------------------------------------------------------------------------- learning: PPO
SPEEDS = np.array([-0.5, 0.0, 0.5, 1.0])  # a decision is one of these shares of the own speed


def learn(room: Room, people: int, seed: int, rollouts: int = 150, rooms: int = 12, decisions: int = 64):
    """Return what all people decide by: from what they see to one of the ``SPEEDS`` each.

    Proximal policy optimization (Schulman et al. 2017): try for a while, then make likelier what turned out better than
    expected (GAE, Schulman et al. 2016), nothing by more than a fifth at once.
    """
    import torch
    from torch import nn

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rng, gamma, lam, clip, rate = np.random.default_rng(seed), 0.98, 0.95, 0.2, 7e-4
    actor, critic = networks = nn.ModuleList(
        nn.Sequential(nn.Linear(SEEN, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))
        for outputs in (len(SPEEDS), 1)
    )
    with torch.no_grad():  # at first, full speed is the likeliest whatever is seen
        actor[-1].weight *= 0.01
        actor[-1].bias[-1] += 2
    adam = torch.optim.Adam(networks.parameters(), eps=1e-5)
    crowds = [draw_crowd(room, people, rng) for _ in range(rooms)]
    shape = (decisions + 1, rooms, people)
    seen, inside, choice = np.zeros((*shape, SEEN), np.float32), np.zeros(shape, bool), np.zeros(shape, np.int64)
    chance, reward, advantage = np.zeros((3, *shape), np.float32)
    for rollout in range(rollouts):
        adam.param_groups[0]["lr"] = rate * (1 - rollout / rollouts)
        # Rooms that are empty, or where a minute is over, are filled again.
        crowds = [c if c.inside.any() and c.clock[0] < 60 else draw_crowd(room, people, rng) for c in crowds]
        to_go = [look(room, c, seen[0, e]) for e, c in enumerate(crowds)]
        inside[0] = [c.inside for c in crowds]
        # Try.
        for t in range(decisions):
            policy = torch.distributions.Categorical(logits=actor(torch.from_numpy(seen[t])).detach())
            choice[t] = policy.sample()
            chance[t] = policy.log_prob(torch.from_numpy(choice[t]))
            for e, crowd in enumerate(crowds):
                to_go[e], reward[t, e] = decide(room, crowd, SPEEDS[choice[t, e]], DEM, to_go[e], seen[t + 1, e])
                inside[t + 1, e] = crowd.inside
        # How much better each decision was than expected; being out is worth 0.
        value = critic(torch.from_numpy(seen)).detach().squeeze(-1).numpy() * inside
        for t in reversed(range(decisions)):
            surprise = reward[t] + gamma * value[t + 1] - value[t]
            advantage[t] = (surprise + gamma * lam * advantage[t + 1] * inside[t + 1]) * inside[t]
        # Learn from the decisions of those who were inside.
        inside[decisions] = False
        data = [torch.from_numpy(a[inside]) for a in (seen, choice, chance, advantage, advantage + value)]
        for _ in range(4):
            for rows in torch.randperm(len(data[0])).split(4096):
                s, a, old, gain, worth = (d[rows] for d in data)
                policy = torch.distributions.Categorical(logits=actor(s))
                ratio, gain = (policy.log_prob(a) - old).exp(), (gain - gain.mean()) / (gain.std() + 1e-8)
                loss = -torch.min(ratio * gain, ratio.clamp(1 - clip, 1 + clip) * gain).mean()
                loss += 0.5 * (critic(s).squeeze(-1) - worth).square().mean() - 0.001 * policy.entropy().mean()
                adam.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(networks.parameters(), 0.5)
                adam.step()
        print(f"\rlearning: {rollout + 1} of {rollouts} rollouts, {time.process_time():.0f} s", end="", flush=True)

    def act(seen, rng):
        """Draw decisions as in learning: two who wait for one another do not do so for ever."""
        chance = actor(torch.from_numpy(seen)).detach().softmax(dim=-1).numpy().cumsum(axis=1)
        return SPEEDS[(rng.random((len(seen), 1)) > chance[:, :-1]).sum(axis=1)]

    return act


# ------------------------------------------------------------------------------------------------- and what comes of it
def evacuate(room: Room, people: int, seed: int, act=None, until: float = 60.0) -> Crowd:
    """Return a crowd after so many seconds, at full speed or as it has learned to ``act``."""
    rng = np.random.default_rng(seed)
    crowd, full, seen = draw_crowd(room, people, rng), np.ones(people), np.zeros((people, SEEN), np.float32)
    to_go = look(room, crowd, seen)
    while crowd.inside.any() and crowd.clock[0] < until:
        to_go, _ = decide(room, crowd, act(seen, rng) if act else full, DEM, to_go, seen)
    return crowd


def picture(room: Room, crowd: Crowd) -> list[str]:
    """Return a room as lines of text; a letter is 0.2 m wide and 0.4 m high."""
    cols, rows = round(room.wall.max() / 0.2), round(room.wall.max() / 0.4)
    text, height = np.full((rows, cols + 1), " "), 0.4 * np.arange(rows) + 0.2
    text[(height < room.door[0, 1]) | (height > room.door[1, 1]), -1] = "|"
    column, row = (crowd.q[crowd.inside] / (0.2, 0.4)).astype(int).T
    text[row.clip(0, rows - 1), column.clip(0, cols - 1)] = "o"
    return ["-" * (cols + 2), *("|" + "".join(line) for line in text[::-1]), "-" * (cols + 2)]


def main(seed: int = 0) -> None:
    """Learn to leave a room of 6 m by a door of 0.6 m, 50 at once, and compare with full speed on 20 fresh crowds."""
    room, people, draws = make_room(6.0, 0.6), 50, range(1_000_000, 1_000_020)
    act = learn(room, people, seed)
    print("\n\n              crowds that leave people inside   people left   last one out, s")
    for name, policy in (("learned", act), ("full speed", None)):
        crowds = [evacuate(room, people, draw, policy) for draw in draws]
        left = np.array([crowd.inside.sum() for crowd in crowds])
        last = np.mean([crowd.exit_time.max() for crowd in crowds if not crowd.inside.any()] or [np.nan])
        print(f"{name:12} {(left > 0).sum():17} of {len(draws)} {left.sum():23} {last:17.1f}")
    shown = draws[int(left.argmax())]
    rooms = [picture(room, evacuate(room, people, shown, policy, until=25.0)) for policy in (None, act)]
    print(f"\nCrowd {shown} after 25 s, at full speed and as it has learned:\n")
    print("\n".join("   ".join(rows) for rows in zip(*rooms, strict=True)))
    print(f"\n{time.process_time():.0f} s of one core")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
