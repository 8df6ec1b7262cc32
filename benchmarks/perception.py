"""Accuracy of perception: random scenes through the physics camera, judged by the simulator's truth.

python benchmarks/perception.py --scene three_bins --seeds 40
python benchmarks/perception.py --scene dense --seeds 20 --verbose
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field

from picktree.robot.perception import Perception
from picktree.robot.perception.view import Detection, PerceivedView
from picktree.simulation import TrueBody
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, Box, Cylinder, Pose, Sphere
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import load_scene

import numpy as np
from scipy.optimize import linear_sum_assignment

FOUND = 0.03
"""A detection of an item's colour this near to it is taken for it, m."""


@dataclass
class Tally:
    """Detections of the items of one kind."""

    kinds: Counter[str] = field(default_factory=Counter)
    places: list[float] = field(default_factory=list)
    heights: list[float] = field(default_factory=list)
    angles: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)


def angle_between(seen: Detection, b: Array) -> float:
    """Angle between the orientation seen and the true one (3, 3), up to what looks the same, rad."""
    a = seen.pose.rotation()
    match seen.shape:
        case Sphere():
            return 0.0
        case Cylinder():
            return math.acos(min(1.0, abs(float(a[:, 2] @ b[:, 2]))))
        case Box(size):
            return min(_turn(a @ s @ b.T) for s in _symmetries(size))
        case _:
            times = max(1, round(2 * math.pi / seen.turn))
            alike = (Pose.from_rpy((0, 0, 0), (0, 0, k * seen.turn)).rotation() for k in range(times))
            return min(_turn(turn @ a @ b.T) for turn in alike)


def _turn(rotation: Array) -> float:
    return math.acos(max(-1.0, min(1.0, (float(np.trace(rotation)) - 1.0) / 2.0)))


def _symmetries(size: tuple[float, float, float]) -> list[Array]:
    found: list[Array] = []
    for order in itertools.permutations(range(3)):
        if any(abs(size[i] - size[order[i]]) > 1e-6 for i in range(3)):
            continue
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return found


def judge(
    truth: tuple[TrueBody, ...], view: PerceivedView, tallies: dict[str, Tally], verbose: str
) -> tuple[int, int]:
    """Note each item's errors; the number of detections that are no item, and of boxes."""
    left = list(view.detections)
    if truth and left:
        costs = np.array([[_distance(t, d) for d in left] for t in truth])
        pairs = [(int(r), int(c)) for r, c in zip(*linear_sum_assignment(costs), strict=True)]
        pairs = [(r, c) for r, c in pairs if costs[r, c] < FOUND]
    else:
        pairs = []
    matched = dict(pairs)
    for row, body in enumerate(truth):
        tally = tallies[body.kind]
        if row not in matched:
            tally.kinds["missed"] += 1
            if verbose:
                print(f"{verbose}: missed {body.id} at {_mm(body.pose)}")
            continue
        seen = left[matched[row]]
        tally.kinds[seen.kind] += 1
        if seen.kind != body.kind:
            if verbose:
                print(
                    f"{verbose}: {body.id} taken for {seen.kind} ({seen.confidence:.2f}) at {_mm(body.pose)}"
                )
            continue
        off = np.array(seen.pose.position) - np.array(body.pose.position)
        tally.places.append(float(np.hypot(off[0], off[1])))
        tally.heights.append(float(off[2]))
        tally.angles.append(angle_between(seen, body.pose.rotation()))
        tally.sigmas.append(seen.sigma_position)
        if verbose and (tally.places[-1] > 0.003 or tally.angles[-1] > 0.1):
            place, height = 1e3 * tally.places[-1], 1e3 * tally.heights[-1]
            angle = math.degrees(tally.angles[-1])
            print(
                f"{verbose}: {body.id} off by {place:.1f} mm, {height:+.1f} mm in height, {angle:.0f}° "
                f"({seen.confidence:.2f}) at {_mm(body.pose)}"
            )
    extra = [d for k, d in enumerate(left) if k not in matched.values()]
    if verbose:
        for d in extra:
            print(f"{verbose}: there is no {d.colour} {d.kind} ({d.confidence:.2f}) at {_mm(d.pose)}")
        for u in view.unexplained:
            size = " × ".join(f"{1e3 * s:.0f}" for s in u.shape.size)
            print(f"{verbose}: box {size} mm at {_mm(u.pose)} ({u.colour})")
    return len(extra), len(view.unexplained)


def _distance(body: TrueBody, seen: Detection) -> float:
    return body.pose.distance(seen.pose) + (0.0 if body.colour == seen.colour else 9.0)


def _mm(pose: Pose) -> str:
    return ", ".join(f"{1e3 * c:.0f}" for c in pose.position)


def row(name: str, tally: Tally) -> str:
    places, heights = 1e3 * np.array(tally.places), 1e3 * np.array(tally.heights)
    angles = np.degrees(tally.angles)
    total, right = sum(tally.kinds.values()), len(tally.places)
    if not right:
        return f"{name:8} {total:5}  {0.0:6.1%}"
    place, angle = np.percentile(places, (50, 95, 100)), np.percentile(angles, (50, 95))
    return (
        f"{name:8} {total:5}  {right / total:6.1%}  {place[0]:7.2f} {place[1]:6.2f} {place[2]:6.2f}"
        f"  {heights.mean():+7.2f}  {angle[0]:6.2f} {angle[1]:6.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="three_bins")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--camera", default="overhead")
    parser.add_argument(
        "--verbose", action="store_true", help="each item that is missed, mistaken or far off"
    )
    options = parser.parse_args()
    scene = load_scene(options.scene)
    robot = load_robot(scene.robot)
    model = RobotModel(robot)
    perception = Perception(scene, model)
    tallies: dict[str, Tally] = defaultdict(Tally)
    milliseconds: list[float] = []
    extra = boxes = 0
    for seed in range(options.first, options.first + options.seeds):
        hardware = PhysicsHardware(scene, robot, seed)
        image = hardware.cameras[options.camera].capture()
        joints, width = hardware.arm.read().position, hardware.gripper.read().width
        if not milliseconds:
            perception.detect(image, joints, width, None)
        began = time.process_time()
        view = perception.detect(image, joints, width, None)
        milliseconds.append(1e3 * (time.process_time() - began))
        there = tuple(body for body in hardware.truth() if body.present)
        more, boxed = judge(there, view, tallies, f"seed {seed}" if options.verbose else "")
        extra, boxes = extra + more, boxes + boxed
        hardware.close()
    print(f"{scene.name}, {options.seeds} scenes; errors in mm and degrees")
    print("kind         n   right   median    p95    max   height   angle    p95")
    everything = Tally()
    for kind in sorted(tallies):
        tally = tallies[kind]
        print(row(kind, tally))
        everything.kinds += tally.kinds
        for name in ("places", "heights", "angles", "sigmas"):
            getattr(everything, name).extend(getattr(tally, name))
    print(row("all", everything))
    mistaken = {f"{k} as {s}": n for k, t in tallies.items() for s, n in t.kinds.items() if s != k}
    print(f"mistaken: {mistaken or 'none'}; no item there: {extra}; unexplained boxes: {boxes}")
    print(f"CPU: {np.median(milliseconds):.1f} ms median, {max(milliseconds):.1f} ms at most")


if __name__ == "__main__":
    main()
