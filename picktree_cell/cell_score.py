"""Score of a cell: where each item lies, by the plant's own truth. picktree never sees it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from .plant import Plant

REST_SPEED, REST_SPIN = 0.02, 1.0
"""Speed, m/s, and spin, rad/s, up to which an item is at rest."""


def score(plant: Plant) -> dict[str, Any]:
    """Return the place of each item, how many are where they belong, and the greatest contact force."""
    items = {item.id: _item(plant, item.id, item.destination) for item in plant.cell.items}
    return {
        "time": round(plant.time, 6),
        "items": items,
        "total": sum(1 for each in items.values() if each["destination"]),
        "sorted": sum(1 for each in items.values() if each["sorted"]),
        "greatest_force": round(plant.greatest_force, 3),
        "stop": plant.stop.name,
    }


def _item(plant: Plant, name: str, destination: str) -> dict[str, Any]:
    q, v = plant.parts.item_q[name], plant.parts.item_v[name]
    at = plant.data.qpos[q : q + 3]
    speed = float(np.linalg.norm(plant.data.qvel[v : v + 3]))
    spin = float(np.linalg.norm(plant.data.qvel[v + 3 : v + 6]))
    within, accepted = "", False
    for place in plant.cell.places:
        if _is_in(
            plant, name, place.frame.at, place.frame.wxyz, place.low, place.high, hole=bool(place.fixture)
        ):
            within = place.id
            accepted = bool(destination) and destination in (place.id, place.fixture)
            break
    rests = speed <= REST_SPEED and spin <= REST_SPIN
    return {
        "at": [round(float(c), 5) for c in at],
        "within": within,
        "destination": destination,
        "rests": rests,
        "sorted": accepted and rests,
    }


def _is_in(
    plant: Plant,
    name: str,
    at: tuple[float, ...],
    wxyz: tuple[float, ...],
    low: tuple[float, ...],
    high: tuple[float, ...],
    *,
    hole: bool,
) -> bool:
    """Return whether an item is in the box: by its centre in a bin, by its lowest point in a hole."""
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, np.array(wxyz))
    q = plant.parts.item_q[name]
    centre = turn.reshape(3, 3).T @ (plant.data.qpos[q : q + 3] - np.array(at))
    if not hole:
        return bool((centre > low).all() and (centre < high).all())
    beside = bool((np.abs(centre[:2]) < np.array(high[:2])).all())
    lowest = _lowest(plant, name, np.array(at), turn.reshape(3, 3))
    return beside and low[2] < lowest < high[2]


def _lowest(plant: Plant, name: str, at: np.ndarray[Any, Any], rotation: np.ndarray[Any, Any]) -> float:
    """Return the height of an item's lowest point in a frame, m."""
    model, data = plant.parts.model, plant.data
    body = model.body(f"item/{name}").id
    down = rotation[:, 2]
    lowest = np.inf
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        turn = data.geom_xmat[geom].reshape(3, 3)
        height = float(down @ (data.geom_xpos[geom] - at))
        along = turn.T @ down
        size, kind = model.geom_size[geom], model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            height -= float(np.abs(along) @ size)
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            height -= float(size[0])
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            height -= float(np.hypot(along[0], along[1]) * size[0] + abs(along[2]) * size[1])
        else:
            mesh = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            height += float((model.mesh_vert[first : first + count] @ along).min())
        lowest = min(lowest, height)
    return lowest
