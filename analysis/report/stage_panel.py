"""Stage panel: the scene in motion in 3-D, with robot, belief, ground truth and plans."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from picktree.analysis import Run
from picktree.analysis.render import bin_tints, body_mesh, heap_remark, part_colour
from picktree.files import PicktreeError
from picktree.logs import RunLog, binary_gltf, log_records, topics, triangle_meshes
from picktree.logs.recording import UNKNOWN_COLOUR, foxglove_messages
from picktree.robot.manipulation import pick_candidates
from picktree.world import COLOURS, Array, Box, Candidates, ConvexMesh, Cylinder, Pose, Shape, Sphere
from picktree.world.robot_model import robot_file

from .body_motion import (
    BelievedBody,
    Frames,
    TrueBodySamples,
    composed,
    continuous,
    filled,
    inverse,
    motion_of,
    row,
    spans,
)
from .packing import Packable, Section, quantise

MAX_LINK_FACES = 3000
"""Maximum number of faces of one link."""
VERTEX_RESOLUTION = 1e-4
"""Rounding of vertices, m."""


def packed_link(model: log_records.LinkMesh) -> Packable:
    """Return the mesh of a link; None for a format that picktree does not write."""
    try:
        mesh = binary_gltf.read_glb(model.glb)
    except (ValueError, KeyError, IndexError, struct.error):
        return None
    if len(mesh.faces) > MAX_LINK_FACES:
        # The file has a vertex for each of its normals; corners at one place become one vertex again.
        places, same = np.unique(np.round(mesh.vertices / VERTEX_RESOLUTION), axis=0, return_inverse=True)
        mesh = triangle_meshes.smooth_mesh(
            *triangle_meshes.decimate(
                places * VERTEX_RESOLUTION, same.ravel()[mesh.faces], mesh.colours, MAX_LINK_FACES
            )
        )
    return {"link": model.link, **packed_mesh(mesh)}


def packed_mesh(mesh: triangle_meshes.Mesh) -> dict[str, Packable]:
    """Pack a mesh with one vertex for all equal corners."""
    corners = np.concatenate(
        [
            np.round(mesh.vertices[mesh.faces.ravel()] / VERTEX_RESOLUTION),
            np.round(mesh.normals.reshape(-1, 3) * 127),
            np.round(mesh.colours.repeat(3, axis=0) * 255),
        ],
        axis=1,
    ).astype(np.int32)
    rows, faces = np.unique(corners, axis=0, return_inverse=True)
    return {
        "vertices": quantise(rows[:, :3] * VERTEX_RESOLUTION, VERTEX_RESOLUTION),
        "normals": rows[:, 3:6].astype(np.int8),
        "colours": rows[:, 6:].astype(np.uint8),
        "faces": faces.astype(np.uint16 if len(rows) < 1 << 16 else np.uint32),
    }


def packed_shape(shape: Shape) -> Packable:
    match shape:
        case Box(size):
            return {"box": list(size)}
        case Cylinder(radius, height):
            return {"cylinder": [radius, height]}
        case Sphere(radius):
            return {"sphere": radius}
        case ConvexMesh():
            return {"mesh": packed_mesh(triangle_meshes.shape_mesh(shape))}


def packed_part(part: log_records.PartRecord) -> Packable:
    """Return the shape of a part that never moves; one with holes is a mesh."""
    if not part.holes:
        return packed_shape(part.shape)
    return {"mesh": packed_mesh(triangle_meshes.part_mesh(part.shape, part.holes))}


def packed_body(body: log_records.BodyRecord, fixed: Sequence[log_records.PartRecord] = ()) -> Packable:
    """Return the shape of a body; blocks of an obstacle or a heap are one mesh."""
    return {"mesh": packed_mesh(body_mesh(body, fixed))} if body.blocks else packed_shape(body.shape)


def rgb(name: str) -> list[Packable]:
    return list(COLOURS.get(name, UNKNOWN_COLOUR))


POSITION_RESOLUTION, QUATERNION_RESOLUTION = 1e-4, 2e-5
"""Rounding of positions, m, and of the components of quaternions."""
PLAN_DISPLAY_TIME = 0.4
"""Time for which the path of a motion is shown beyond its planned end, s."""
CANDIDATE_DISPLAY_TIME = 2.0
"""Time for which the candidates of a search are shown, s."""


def pack_stage(run: Run) -> Section:
    motion = motion_of(run)
    frames, believed, truths, partners = motion.frames, motion.believed, motion.truths, motion.partners
    models = run.log.robot_model()
    links = [model.link for model in models if model.link in frames.tracks]
    scene = run.log.belief_at(run.end) or run.log.truth_at(run.end)
    fixed = scene.record.fixed if scene is not None else ()
    return Section(
        "stage",
        {
            "models": [packed for m in models if m.link in links and (packed := packed_link(m)) is not None],
            "links": list(links),
            "chain": [_pose_track(track) for track in _chain(frames, links)],
            "tool": packed_tool(run.log, links),
            "objects": [_object(one, fixed) for one in believed],
            "truths": map(_truth, truths, motion.true, partners),
            "fixed": packed_fixed(run.log, fixed),
            "plans": _plans(run),
            "choices": _choices(run),
            "cameras": _cameras(run, frames),
        },
    )


def _chain(frames: Frames, links: Sequence[str]) -> list[Array]:
    """Return each link in the frame of the one before it, the first in the world, because few of these poses
    change."""
    tracks = [filled(frames.track(link)) for link in links]
    return [tracks[k] if k == 0 else composed(inverse(tracks[k - 1]), tracks[k]) for k in range(len(tracks))]


def _pose_track(track: Array) -> Packable:
    smooth = continuous(track)
    return {
        "p": quantise(smooth[:, :3], POSITION_RESOLUTION),
        "q": quantise(smooth[:, 3:], QUATERNION_RESOLUTION),
    }


def packed_tool(log: RunLog, links: Sequence[str]) -> Packable:
    """Return the TCP: a link's place in the chain and a pose in it; None when the log has no usable robot
    file."""
    if not links:
        return None
    try:
        text = log.attachment("robot.yaml").decode("utf-8", "replace")
        tcp = robot_file.read_tcp(text, log.path)
    except PicktreeError:
        tcp = None
    if tcp is None or tcp.link not in links:
        return {"link": len(links) - 1, "at": list(row(Pose()))}
    return {"link": links.index(tcp.link), "at": list(row(tcp.pose()))}


def _object(one: BelievedBody, fixed: Sequence[log_records.PartRecord]) -> Packable:
    return {
        "id": one.id,
        "looks": [
            {
                "tick": look.tick,
                "shape": packed_body(look.body, fixed),
                "colour": rgb(look.body.colour),
                **{name: getattr(look.body, name) for name in ("kind", "role", "place")},
                "remark": heap_remark(look.body, fixed),
            }
            for look in one.looks
        ],
        "present": [list(span) for span in spans(one.present)],
        "held": [list(span) for span in spans(one.held)],
        "track": _pose_track(filled(one.track)),
    }


def _truth(truth: TrueBodySamples, poses: Array, partner: int | None) -> Packable:
    return {
        "id": truth.body.id,
        "kind": truth.body.kind,
        "shape": packed_shape(truth.body.shape),
        "colour": rgb(truth.body.colour),
        "object": partner,
        "present": [list(span) for span in spans(~np.isnan(poses[:, 0]))],
        "track": _pose_track(filled(poses)),
    }


def packed_fixed(log: RunLog, parts: Sequence[log_records.PartRecord]) -> Packable:
    """Pack the parts that never move, bins in the tint of their items."""
    tints = bin_tints(log)
    return [
        {
            "id": part.id.split("/")[0],
            "shape": packed_part(part),
            "colour": [round(share, 4) for share in part_colour(part, tints)],
            "pose": list(row(part.pose)),
        }
        for part in parts
    ]


def _plans(run: Run) -> Packable:
    """Pack the plans, each with the time from its request to its end, or to the next one."""
    found: list[Packable] = []
    for k, at in enumerate(run.plans):
        plan = at.record
        end = at.time + plan.thinking + plan.duration + PLAN_DISPLAY_TIME
        if k + 1 < len(run.plans):
            end = min(end, run.plans[k + 1].time)
        if len(plan.tool_path) > 1:
            points = quantise(np.array(plan.tool_path), 1e-3)
            found.append({"from": at.time, "to": end, "request": plan.request, "path": points})
    return found


def _choices(run: Run) -> Packable:
    """Pack candidates of grasps and places for a limited time, with their verdicts."""
    found: list[Packable] = []
    for k, at in enumerate(run.candidates):
        end = at.time + CANDIDATE_DISPLAY_TIME
        if k + 1 < len(run.candidates):
            end = min(end, run.candidates[k + 1].time)
        tried = at.record.tried
        found.append(
            {
                "from": at.time,
                "to": end,
                "object": at.record.object,
                "summary": search_summary(at.record),
                "poses": quantise(
                    np.array([(*c.position, *c.orientation) for c in tried]).reshape(-1, 7), 1e-3
                ),
                "accepted": np.array(
                    [c.verdict == pick_candidates.ACCEPTED_VERDICT for c in tried], dtype=np.uint8
                ),
                "verdicts": [f"{c.name}: {c.verdict}" for c in tried],
            }
        )
    return found


def search_summary(search: Candidates) -> str:
    """Return `tote_heap: 14 candidates, 3 checked, 1 taken; refused: 2 …` for a search."""
    taken = sum(c.verdict == pick_candidates.ACCEPTED_VERDICT for c in search.tried)
    ranked = search.stages[0].count if search.stages else len(search.tried)
    checked = len({c.name for c in search.tried})
    counts = f"{max(ranked, checked)} candidates, {checked} checked, {taken or 'none'} taken"
    refused = pick_candidates.describe_rejections(pick_candidates.count_rejections(search.tried, search.into))
    return f"{search.object}: {counts}" + (f"; refused: {refused}" if refused else "")


def _cameras(run: Run, frames: Frames) -> Packable:
    """Pack the optical frames: z points out of the camera, y down the image."""
    found: list[Packable] = []
    for camera in run.log.cameras:
        raw = run.log.last(topics.calibration_topic(camera).name, run.end)
        frame = f"camera/{camera}"
        if raw is None or frame not in frames.tracks:
            continue
        seen = foxglove_messages.read_calibration(raw.data)
        found.append(
            {
                "name": camera,
                "width": seen.width,
                "height": seen.height,
                "focal": [seen.fx, seen.fy],
                "centre": [seen.cx, seen.cy],
                "track": _pose_track(filled(frames.track(frame))),
            }
        )
    return found
