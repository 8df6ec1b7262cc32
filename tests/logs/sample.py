"""A small run of three seconds that never happened, with something on every topic.

`python tests/logs/sample.py` writes the golden log of the present format; those of older ones stay.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from picktree.logs import RunLog, encode, topics
from picktree.logs.binary_gltf import write_glb
from picktree.logs.log_records import FORMAT, Control, LinkMesh, NodeTime, RunInfo, Timing
from picktree.logs.recording import Recorder
from picktree.logs.triangle_meshes import shape_mesh
from picktree.world import (
    BeliefObject,
    BlackboardWrite,
    Box,
    Candidate,
    Candidates,
    ConvexMesh,
    Cylinder,
    GripperState,
    ImageEntry,
    Intrinsics,
    JointState,
    NodeState,
    ObjectId,
    OtherEvent,
    Plan,
    PlanningScene,
    Pose,
    RgbdImage,
    Shape,
    Sphere,
    StageCount,
    Tick,
    Transition,
    Tree,
    TreeNode,
    Wrench,
)
from picktree.world.scene import Bin, Fixture

GOLDEN = Path(__file__).parent / "golden"
TICK = 0.05
RUN = RunInfo(
    mission="sort by colour",
    scene="three_bins",
    robot="panda",
    seed=7,
    backend="kinematic",
    tick=TICK,
    parameters={"speed": "0.5"},
    physics={"step": "1/240 s"},
    versions={"picktree": "0.1.0"},
    revision="0123abc",
)
LINKS = {"base": Pose(), "arm": Pose((0.0, 0.0, 0.5)), "hand": Pose((0.4, 0.0, 0.3), (1.0, 0.0, 0.0, 0.0))}
MESHES = tuple(LinkMesh(link, write_glb(shape_mesh(Box((0.1, 0.1, 0.4))))) for link in LINKS)
TABLE = Fixture(ObjectId("table"), Box((1.2, 1.6, 0.04)), Pose((0.5, 0.0, -0.02)), "light_grey")
BIN = Bin(ObjectId("red_bin"), (0.25, 0.2, 0.1), 0.005, Pose((0.35, 0.55, 0.0)), "grey")
WEDGE = ConvexMesh(
    ((-0.02, -0.02, -0.01), (0.02, -0.02, -0.01), (0.0, 0.02, -0.01), (0.0, 0.0, 0.03)), "wedge.obj"
)


def item(name: str, shape: Shape, colour: str, x: float, seen: float = 0.0) -> BeliefObject:
    return BeliefObject(
        id=ObjectId(name),
        role="item",
        kind="block",
        form="box",
        shape=shape,
        colour=colour,
        pose=Pose((x, 0.0, 0.02)),
        sigma_position=0.001,
        sigma_angle=0.01,
        confidence=0.9,
        last_seen=seen,
    )


MISSED = "the fingers closed at 0.4 mm"
EVIDENCE = {"width": 0.0004, "names": ["a", "b"]}


def tick(k: int) -> Tick:
    failed = k == 30
    status, cause = ("FAILURE", "grasp.missed") if failed else ("RUNNING", "")
    evidence = EVIDENCE if failed else {}
    first = (
        BlackboardWrite("/item", "red_block_1", "/Main"),
        BlackboardWrite("/items", ["red_block_1"], "/Main"),
    )
    return Tick(
        root_status="RUNNING",
        tip="/Main/Grasp",
        nodes=(
            NodeState("/Main", "Sequence", status, True, MISSED if failed else "", cause, evidence),
            NodeState(
                "/Main/Grasp", "Grasp", status, True, MISSED if failed else "approaching", cause, evidence
            ),
        ),
        writes=first if k == 0 else (),
        transitions=_transitions(k),
    )


def _transitions(k: int) -> tuple[Transition, ...]:
    begin = (
        Transition("/Main", "RUNNING"),
        Transition("/Main/Grasp", "RUNNING", {"object": "red_block_1"}, "red_block_1", message="approaching"),
    )
    end = tuple(
        Transition(
            path, "FAILURE", cause="grasp.missed", origin="/Main/Grasp",
            message=MISSED, evidence=EVIDENCE,
        )
        for path in ("/Main/Grasp", "/Main")
    )  # fmt: skip
    return begin if k in (0, 31) else end if k == 30 else ()


def image(now: float) -> RgbdImage:
    rng = np.random.default_rng(3)
    colour = rng.integers(0, 255, (12, 16, 3), dtype=np.uint8)
    depth = rng.uniform(0.5, 0.9, (12, 16)).astype(np.float32)
    depth[0, 0] = 0.0
    pose = Pose((0.5, 0.0, 0.75), (1.0, 0.0, 0.0, 0.0))
    return RgbdImage("overhead", colour, depth, now, Intrinsics(16, 12, 14.0, 14.0, 8.0, 6.0), pose)


def start(recorder: Recorder) -> None:
    """What stands at the beginning of every log."""
    recorder.attach("mission.yaml", "picktree: 1\nkind: mission\n", "application/yaml")
    recorder.tree(
        Tree(
            (
                TreeNode("/Main", "Sequence", "Main", "", ("/Main/Grasp",)),
                TreeNode("/Main/Grasp", "Grasp", "Grasp", "/Main", (), {"object": "{item}"}),
            )
        )
    )
    recorder.robot_model(MESHES)
    recorder.fixed([TABLE], [BIN])


def step(
    recorder: Recorder, scene: PlanningScene, k: int, wall: float = 0.004, instead: Tick | None = None
) -> None:
    """Tick number k, or another in its place."""
    now = k * TICK
    if k == 0:
        shapes = (Box((0.04, 0.04, 0.04)), Cylinder(0.02, 0.08), Sphere(0.025), WEDGE)
        for n, (shape, colour) in enumerate(zip(shapes, ("red", "green", "blue", "yellow"), strict=True), 1):
            scene.put(item(f"{colour}_block_{n}", shape, colour, 0.3 + 0.1 * n), "seen")
        recorder.entry(now, ImageEntry(image(now), ("red block", "green can")))
    if k == 10:
        recorder.entry(
            now,
            Plan(
                "to home",
                "direct",
                12,
                0.0003,
                "found",
                "",
                1.5,
                ((0.0, 1.0), (0.5, 1.5)),
                ((0.4, 0.0, 0.3),),
            ),
        )
        recorder.entry(
            now,
            Candidates(
                "grasp",
                ObjectId("red_block_1"),
                (StageCount("made", 8), StageCount("reachable", 5)),
                (Candidate("top", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.7, "accepted"),),
            ),
        )
        scene.attach("red_block_1", Pose())
    if k == 40:
        recorder.entry(
            now,
            OtherEvent(
                "SafeRetreat after grasp.missed", "/Main/Grasp", name="recovery", extra={"attempt": 1}
            ),
        )
        scene.remove("blue_block_3", "its place was seen empty")
    recorder.joints(
        now, ("j1", "j2"), JointState(np.array([0.01 * k, 1.0]), np.zeros(2), np.ones(2)),
        ("left", "right"), GripperState(0.04, 0.0, 30.0),
    )  # fmt: skip
    recorder.transforms(now, LINKS, scene.objects)
    recorder.wrench(now, Wrench((0.0, 0.0, 3.0), (0.1, 0.0, 0.0)))
    recorder.control(now, Control("Track", (0.01 * k + 0.002, 1.0), (0.002, 0.0)))
    recorder.belief(now, scene.objects, scene.take_changes())
    if recorder.truth_due(now):
        recorder.truth(now, scene.objects)
    recorder.tick(now, instead or tick(k))
    recorder.timing(now, Timing(wall, physics=wall / 2, nodes=(NodeTime("/Main/Grasp", wall / 4),)))


def record(
    path: Path,
    ticks: int = 60,
    *,
    wall_time: float = 0.004,
    checkpoint: float = 1.0,
    chunk_bytes: int = 4 << 20,
) -> str:
    """Record the run and return its digest. `wall_time` is what the ticks are said to take, s."""
    scene = PlanningScene([TABLE], [BIN])
    with Recorder(path, RUN, checkpoint=checkpoint, chunk_bytes=chunk_bytes) as recorder:
        start(recorder)
        for k in range(ticks):
            step(recorder, scene, k, wall_time)
        recorder.finish({"status": "SUCCESS"})
        return recorder.digest


def told(path: Path) -> dict[str, object]:
    """What the log says, as JSON values."""
    with RunLog(path) as log:
        shots = [
            {
                "time": s.time,
                "colour": s.record.colour.ravel()[:6],
                "depth": s.record.depth.ravel()[:6].round(3),
            }
            for s in log.images("overhead")
        ]
        raw = {
            "run": log.run,
            "result": log.result,
            "end": log.end,
            "topics": log.topics,
            "attachments": {name: log.attachment(name).decode() for name in log.attachments},
            "tree": log.tree(),
            "robot": [mesh.link for mesh in log.robot_model()],
            "ticks": [*log.ticks(0.0, 0.1), *log.ticks(1.5, 1.5)],
            "timings": list(log.timings(0.0, 0.0)),
            "joints": list(log.joints(1.0, 1.05)),
            "transforms": list(log.transforms(0.0, 0.0)),
            "wrenches": list(log.wrenches(0.0, 0.0)),
            "controls": list(log.controls(1.0, 1.0)),
            "belief": log.belief_at(2.5),
            "truth": log.truth_at(0.9),
            "plans": list(log.plans()),
            "candidates": list(log.candidates()),
            "events": [
                {"time": message.time / 1e9, "record": json.loads(message.data)}
                for message in log.messages((topics.EVENTS.name,))
            ],
            "lines": list(log.lines()),
            "shots": shots,
        }
    return json.loads(encode(raw))


if __name__ == "__main__":
    golden = GOLDEN / f"format-{FORMAT}.mcap"
    record(golden)
    golden.with_suffix(".json").write_text(json.dumps(told(golden), indent=1) + "\n")
