"""Campaign: holes in the picture of a camera on the hand, on a board that stands up to 5 mm and 2° off.

    python benchmarks/mouths.py --runs 20

For each seed the board of the scene `pegs` is set down and every hole looked at from a place of its own: 17
to 25 cm away, up to 23° aslant, turned anyhow, with the noise of a camera. No robot moves: this measures
`robot/perception/hole_mouths.py` alone. Nothing is kept; twenty seeds take half a minute of CPU.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass, replace

from _campaign import rate
from picktree.robot.perception import detect_hole
from picktree.simulation import displace_fixtures, noisy_colour, noisy_depth
from picktree.simulation.physics import CameraRenderer, Client
from picktree.simulation.physics.bodies import add_scenery
from picktree.world import Pose, RgbdImage
from picktree.world.scene import CameraDescription, Hole, SceneDescription, load_scene
from picktree.world.scene.scene_entries import look_at_frame

import numpy as np

COST = 1.1
"""CPU seconds a seed, for the forecast."""
OFF = 0.008
"""To which the belief is trusted, m."""


@dataclass(frozen=True)
class Miss:
    """How far a found mouth is from the true one: m, rad (turn None for a round hole)."""

    aside: float
    height: float
    tilt: float
    turn: float | None


def picture(camera: CameraDescription, client: int, believed: Pose, rng: np.random.Generator) -> RgbdImage:
    """Take a picture from a random place above a believed mouth."""
    distance, around, aslant = rng.uniform(0.17, 0.25), rng.uniform(-3, 3), rng.uniform(0, 0.4)
    x, y, z = believed.position
    at = (
        x + distance * math.sin(aslant) * math.cos(around),
        y + distance * math.sin(aslant) * math.sin(around),
        z + distance * math.cos(aslant),
    )
    roll = rng.uniform(-3, 3)
    towards = (x + rng.uniform(-0.02, 0.02), y + rng.uniform(-0.02, 0.02), z)
    optical = look_at_frame(at, towards, (math.cos(roll), math.sin(roll), 0.1))
    assert optical is not None
    seen = CameraRenderer(camera).render(client, optical)
    depth = np.where(np.isfinite(seen.depth), seen.depth, np.float32(0.0))
    colour = noisy_colour(seen.colour, rng)
    return RgbdImage("wrist", colour, noisy_depth(depth, camera, rng), 0.0, camera.intrinsics, optical)


def looked(scene: SceneDescription, seed: int) -> list[tuple[Hole, Miss | None]]:
    """Every hole of the board once; None where it was not found."""
    rng = np.random.default_rng([seed, 11])
    really = displace_fixtures(scene, seed)
    client = Client()
    add_scenery(really.fixtures, really.bins, client.id)
    camera = replace(scene.cameras[0], near=0.05)
    board, truly = scene.fixture("board"), really.fixture("board")
    found: list[tuple[Hole, Miss | None]] = []
    for hole in board.holes:
        believed = board.pose @ hole.pose
        seen = detect_hole(picture(camera, client.id, believed, rng), hole, believed, OFF)
        if seen is None:
            found.append((hole, None))
            continue
        miss = (truly.pose @ hole.pose).inverse() @ seen.pose
        x, y, z = miss.position
        turn = miss.rotation()
        yaw = abs(math.atan2(float(turn[1, 0]), float(turn[0, 0])))
        tilt = math.acos(min(1.0, float(turn[2, 2])))
        found.append((hole, Miss(math.hypot(x, y), abs(z), tilt, None if hole.form == "round" else yaw)))
    return found


def spread(name: str, values: list[float], unit: str) -> str:
    middle, high, most = np.percentile(values, (50, 95, 100)).tolist()
    return f"  {name:<12} {middle:.3f} {unit} median, {high:.3f} in 95 %, {most:.3f} at most"


def main() -> int:
    parser = argparse.ArgumentParser(description="How well a hole is found in the hand camera's picture.")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args()
    print(f"about {options.runs * COST / 60:.1f} CPU minutes", flush=True)
    scene = load_scene("pegs")
    started = time.process_time()
    rows = [row for seed in range(options.runs) for row in looked(scene, options.first + seed)]
    for form in ("round", "square", "slot"):
        of_form = [miss for hole, miss in rows if hole.form == form]
        found = [miss for miss in of_form if miss is not None]
        print(rate(form, len(found), len(of_form)))
        if not found:
            continue
        print(spread("aside", [1000 * miss.aside for miss in found], "mm"))
        print(spread("height", [1000 * miss.height for miss in found], "mm"))
        print(spread("tilt", [math.degrees(miss.tilt) for miss in found], "°"))
        turns = [math.degrees(miss.turn) for miss in found if miss.turn is not None]
        if turns:
            print(spread("turn", turns, "°"))
    print(f"{1000 * (time.process_time() - started) / len(rows):.0f} ms CPU a picture, rendering included")
    return 0


if __name__ == "__main__":
    sys.exit(main())
