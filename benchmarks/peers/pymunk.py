"""pymunk (Chipmunk 2D): discs without friction that are driven towards the door, as a game would.

Ten iterations, and a slop of 1 mm: its default, 0.1, is in units of length, 10 cm here.  Velocities are read and written in
batches, which belongs to the step.  Bodies carry a rotation that nothing turns.
"""

from collections.abc import Iterator

import numpy as np
import pymunk
import pymunk.batch

from benchmarks.measuring import Effort
from benchmarks.peers.walking import DT, PeerCrowd
from benchmarks.scenes import Floats, Scene

ITERATIONS = 10
SLOP = 1e-3  # m
_MOVING = pymunk.batch.BodyFields.POSITION | pymunk.batch.BodyFields.VELOCITY
_FIELDS = pymunk.batch.BodyFields.BODY_ID | _MOVING


class Discs(PeerCrowd):
    """A scene in which everyone's velocity relaxes to the desired one, straight to the door."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(f"{ITERATIONS} iterations", "pymunk", scene)

    def _build(self) -> None:
        scene = self._scene
        self._space = pymunk.Space()
        self._space.iterations = ITERATIONS
        self._space.collision_slop = SLOP
        for a, b in scene.walls:
            wall = pymunk.Segment(self._space.static_body, a, b, 0.0)
            wall.friction = wall.elasticity = 0.0
            self._space.add(wall)
        self._number: dict[int, int] = {}
        self._disc: dict[int, pymunk.Circle] = {}
        for k in range(scene.people):
            radius, mass = float(scene.bodies.radius[k]), float(scene.bodies.mass[k])
            body = pymunk.Body(mass, pymunk.moment_for_circle(mass, 0.0, radius))
            body.position = float(scene.position[k, 0]), float(scene.position[k, 1])
            disc = pymunk.Circle(body, radius)
            disc.friction = disc.elasticity = 0.0
            self._space.add(body, disc)
            self._number[body.id] = k
            self._disc[k] = disc
        self._buffer = pymunk.batch.Buffer()
        self._read()

    def _read(self) -> None:
        """Read everyone's position and velocity; the body of the walls comes along."""
        self._fill(_FIELDS)
        ids = np.frombuffer(self._buffer.int_buf(), dtype=np.uintp)
        self._who = np.array([self._number.get(one, -1) for one in ids.tolist()], dtype=np.int64)

    def _fill(self, fields: pymunk.batch.BodyFields) -> None:
        """Fill the buffer, and take positions and velocities from it."""
        self._buffer.clear()
        pymunk.batch.get_space_bodies(self._space, fields, self._buffer)
        self._state = np.frombuffer(self._buffer.float_buf()).reshape(-1, 4).copy()

    def _step(self) -> None:
        scene, state, who = self._scene, self._state, self._who
        radius, speed = scene.bodies.radius[who], np.where(who >= 0, scene.bodies.desired_speed[who], 0.0)
        inset = np.minimum(radius, 0.49 * scene.door)
        middle, half = 0.5 * scene.side, 0.5 * scene.door
        aim = np.clip(state[:, 1], middle - half + inset, middle + half - inset)
        way = np.stack([scene.side + 0.2 - state[:, 0], aim - state[:, 1]], axis=1)
        way *= (speed / np.sqrt((way**2).sum(axis=1)))[:, None]
        velocity = state[:, 2:] + (DT / scene.bodies.relaxation_time[who])[:, None] * (way - state[:, 2:])
        written = pymunk.batch.Buffer()
        written.set_float_buf(np.ascontiguousarray(velocity))
        pymunk.batch.set_space_bodies(self._space, pymunk.batch.BodyFields.VELOCITY, written)
        self._space.step(DT)
        self._fill(_MOVING)
        out = self._who[(self._state[:, 0] > scene.side) & (self._who >= 0)]
        for k in out.tolist():
            disc = self._disc.pop(k)
            self._space.remove(disc, disc.body)
        if len(out):
            self._read()

    @property
    def inside(self) -> int:
        """Number of people inside."""
        return len(self._disc)

    def _people(self) -> tuple[np.ndarray, Floats]:
        there = self._who >= 0
        return self._who[there], self._state[there, :2]


def crowds(scene: Scene, effort: Effort) -> Iterator[Discs]:
    """Yield the scene."""
    yield Discs(scene)
