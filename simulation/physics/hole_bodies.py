"""Fixtures with holes in pybullet: one static body for each convex piece of what is left of the box.

`createCollisionShapeArray` takes no vertices, and a shape of a mesh file is kept under the file's name for
good, so a piece is a body of its own; all have the fixture's name in contacts.
"""

from __future__ import annotations

from functools import cache

from ...world.scene.description import Fixture
from ...world.scene.fixture_surfaces import surface
from ...world.scene.hole_geometry import bored
from ...world.shapes import Box
from .engine.pybullet_import import pb


def add_bored(fixture: Fixture, client: int) -> tuple[int, ...]:
    """The pieces of the fixture, to be touched but not seen; pybullet's body numbers."""
    numbers: list[int] = []
    for piece, piece_in_fixture in bored(fixture):
        pose = fixture.pose @ piece_in_fixture
        shape = pb.createCollisionShape(pb.GEOM_MESH, vertices=piece.vertices, physicsClientId=client)
        number = pb.createMultiBody(0.0, shape, -1, pose.position, pose.orientation, physicsClientId=client)
        # Hulls are made 1 mm larger all round by default, which would take 2 mm from every hole.
        pb.changeDynamics(number, -1, collisionMargin=0.0, physicsClientId=client)
        numbers.append(number)
    return tuple(numbers)


def bored_visual(fixture: Fixture, rgba: tuple[float, float, float, float], client: int) -> int:
    """A visual shape of the fixture in its own frame, with the insides of its holes."""
    corners, order, normals = _lists(fixture)
    return pb.createVisualShape(
        pb.GEOM_MESH,
        vertices=corners,
        indices=order,
        normals=normals,
        rgbaColor=rgba,
        physicsClientId=client,
    )


@cache
def _lists(fixture: Fixture) -> tuple[list[list[float]], list[int], list[list[float]]]:
    """Made once: pybullet never lets go of the lists."""
    assert isinstance(fixture.shape, Box)
    seen = surface(fixture.shape, fixture.holes)
    return seen.corners.tolist(), list(range(len(seen.corners))), seen.normals.tolist()
