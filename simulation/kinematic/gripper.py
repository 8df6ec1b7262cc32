"""Gripper of the kinematic backend: it closes until an item stops the fingers, and then holds that item."""

from __future__ import annotations

from ...robots.description import GripperDescription
from ...world.shapes import extents
from ...world.values import GRAVITY, GripperState, ObjectId, Pose
from ..checkpoints import GripperCommand
from ..faults.device_faults import DeviceFaults
from .bodies import KinematicBodies, KinematicBody

MIN_GRASP_OVERLAP = 0.001
"""Least overlap of an item with the pads for a grasp, m."""


class KinematicGripper:
    """`protocols.Gripper` of the kinematic backend. Holding needs friction: 2μF must carry the weight."""

    def __init__(
        self, description: GripperDescription, bodies: KinematicBodies, ailments: DeviceFaults | None = None
    ) -> None:
        self._description = description
        self._ailments = ailments or DeviceFaults(())
        self._bodies = bodies
        pad = description.pads[0][0].size
        self._reach_x = pad[0] / 2
        self._lowest, self._highest = description.tip - pad[2], description.tip
        self.width = description.max_width
        self.target = description.max_width
        self.force = 0.0
        self.speed = 0.0
        self.most_speed = description.speed
        """Greatest speed of each finger, m/s."""
        self.item_in_tcp: Pose | None = None
        self.gripped = 0.0
        """Width of the held item, m."""

    def read(self) -> GripperState:
        force = self._drive.force if self._ailments.any else self.force
        return GripperState(self.width, self.speed, force if self.speed == 0.0 else 0.0)

    @property
    def moves(self) -> bool:
        """Whether the fingers have not reached their target."""
        if not self._ailments.any:
            return self.width != self.target
        return self.width != self._drive.width

    @property
    def _drive(self) -> GripperCommand:
        """Command that the drives carry out: the received one, unless a fault changes it."""
        ailments = self._ailments
        if ailments.jam is not None:
            return GripperCommand(self.width, ailments.jam.force)
        return GripperCommand(self.target, self.force * ailments.grip_share)

    def command(self, width: float, force: float, speed: float | None = None) -> None:
        self.most_speed = min(speed or self._description.speed, self._description.speed)
        self.target = min(max(width, 0.0), self._description.max_width)
        self.force = min(max(force, 0.0), self._description.max_force)

    def step(self, tcp: Pose, period: float) -> None:
        """Advance by one control period with the TCP at `tcp` in the world."""
        bodies = self._bodies
        held, drive = bodies.held, self._drive
        # An item as wide as the full opening is released by fingers that open fully.
        wide = min(self.gripped + 5e-4, self._description.max_width - 1e-9)
        opens = self._ailments.jam is None and self.target > wide
        if held is not None:
            assert self.item_in_tcp is not None
            if opens or not self._carries(bodies[held], drive.force):
                bodies.carry(tcp @ self.item_in_tcp)
                bodies.let_go()
            else:
                bodies.carry(tcp @ self.item_in_tcp)
                self.speed = 0.0
                return
        most = 2.0 * self.most_speed * period
        before = self.width
        width = before + min(max(drive.width - before, -most), most)
        if width < before and (caught := self._caught(tcp, before, width)) is not None:
            item, pose, self.gripped = caught
            width = self.gripped
            bodies.take(item, tcp @ pose)
            self.item_in_tcp = pose
        self.width = width
        self.speed = (width - before) / period

    def _carries(self, body: KinematicBody, force: float) -> bool:
        friction = body.friction * self._description.pad_contact.friction
        return 2.0 * friction * force >= body.entry.mass * GRAVITY

    def _caught(self, tcp: Pose, before: float, width: float) -> tuple[ObjectId, Pose, float] | None:
        """Return the item that stops the fingers between two openings, its centred pose in the TCP frame, and
        its width, m; None: no item."""
        world_in_tcp: Pose | None = None
        reach = self._description.max_width
        for body in self._bodies.present:
            if body.pose.distance(tcp) > reach + max(self._reach_x, 0.1):
                continue
            world_in_tcp = world_in_tcp or tcp.inverse()
            pose = world_in_tcp @ body.pose
            low, high = extents(body.entry.shape, pose.rotation())
            x, y, z = pose.position
            inside_x = min(x + float(high[0]), self._reach_x) - max(x + float(low[0]), -self._reach_x)
            inside_z = min(z + float(high[2]), self._highest) - max(z + float(low[2]), self._lowest)
            if min(inside_x, inside_z) < MIN_GRASP_OVERLAP:
                continue
            left, right = y + float(low[1]), y + float(high[1])
            size = right - left
            # The finger that touches first pushes the item along until the other one is there, too.
            if abs(left + right) > before or width > size:
                continue
            return body.id, pose.shifted((0.0, -(left + right) / 2, 0.0)), size
        return None
