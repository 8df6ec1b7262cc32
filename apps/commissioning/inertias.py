"""Check of the mass and inertia that a URDF gives its links, and replacements for impossible values."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from picktree.world import Array, Vector3, vector3
from picktree.world.robot_model import MOVING, gripper_mounting, urdf_parser

from .link_geometry import LinkGeometry

DEFAULT_DENSITY = 1000.0
"""Density assumed for a link without a given mass, kg/m³."""
MIN_DENSITY, MAX_DENSITY = 50.0, 20_000.0
"""Least and greatest plausible density, kg/m³: foam, and denser than any machine."""
MAX_MOMENT_SHARE = 0.99
"""Largest principal moment of a corrected link, as a share of the sum of the two others."""
MAX_GYRATION_RADIUS = 2.0
"""Radius of gyration above which an inertia is implausible, in half diagonals of the link."""
MIN_MOMENT = 1e-9
"""Least principal moment, kg·m²."""
MIN_LINKAGE_MOMENT = 0.003
"""Least moment of a linkage's links, kg·m²: the motor's rotor adds it through its gear."""

Kind = Literal["missing", "zero", "impossible", "implausible"]


@dataclass(frozen=True, slots=True)
class InertiaFinding:
    """Finding about a link's inertia, and its replacement; None: the finding is reported only."""

    link: str
    kind: Kind
    sentence: str
    instead: gripper_mounting.LinkInertia | None
    density: float = 0.0
    """Density from which the replacement is guessed, kg/m³; 0: it is not guessed from a hull's volume."""


def check_inertias(
    root: ElementTree.Element, skeleton: urdf_parser.UrdfTree, solids: Mapping[str, LinkGeometry]
) -> tuple[InertiaFinding, ...]:
    """Check all links that joints move, in the order of the file; static links are not checked."""
    found: list[InertiaFinding] = []
    moved = {joint.child for joint in skeleton.joints.values() if joint.type in MOVING}
    carried = {
        link
        for joint in skeleton.joints.values()
        if joint.type in MOVING
        for link in skeleton.below(joint.child)
    }
    for element in root.findall("link"):
        name = element.get("name", "")
        if name in carried:
            finding = _finding(element, name, solids.get(name), moves=name in moved)
            if finding is not None:
                found.append(finding)
    return tuple(found)


def _finding(
    element: ElementTree.Element, name: str, solid: LinkGeometry | None, *, moves: bool
) -> InertiaFinding | None:
    inertia = _read(element)
    if inertia is None or inertia[0] <= 0.0:
        if solid is None and not moves:
            return None  # a mere frame
        kind: Kind = "missing" if inertia is None else "zero"
        what = "has no <inertial>" if inertia is None else f"weighs {inertia[0]:g} kg"
        why = "but a joint moves it" if moves else "but a shape"
        instead = _from_solid(solid)
        density = 0.0 if solid is None else DEFAULT_DENSITY
        return InertiaFinding(name, kind, f"{what}, {why}{_remedy(instead, density)}", instead, density)
    mass, com, matrix = inertia
    moments, axes = np.linalg.eigh(matrix)
    low, middle, high = (float(m) for m in moments)
    if low <= 0.0 or high > low + middle:
        if low <= 0.0:
            why = "a principal moment is not positive" if matrix.any() else "has a mass, but no <inertia>"
        else:
            why = f"the largest principal moment, {high:.3g} kg·m², is greater than the sum of the others"
        put = np.maximum(moments, MIN_MOMENT)
        if low <= 0.0 and put[1] <= MIN_MOMENT and solid is not None:
            return InertiaFinding(
                name,
                "impossible",
                f"{why}: the robot file gives it the inertia of its hull, a guess",
                _scaled(solid, mass),
            )
        put[0] = max(put[0], 1e-3 * float(put[2]))
        put[1] = max(put[1], put[0])
        put[2] = min(float(put[2]), MAX_MOMENT_SHARE * float(put[0] + put[1]))
        put[2] = max(put[2], put[1])
        if put[2] > put[0] + put[1]:
            put[0] = put[2] - MAX_MOMENT_SHARE * put[1]
        whole = axes @ np.diag(put) @ axes.T
        return InertiaFinding(
            name, "impossible", f"{why}: the robot file reduces it", _inertia(mass, com, whole)
        )
    if solid is None:
        return None
    volume = solid.volume()
    half = float(np.linalg.norm(np.ptp(solid.points, axis=0))) / 2
    if volume > 0.0 and not MIN_DENSITY <= mass / volume <= MAX_DENSITY:
        sentence = (
            f"{mass:g} kg in a hull of {volume * 1e6:.3g} cm³ is a density of {mass / volume:.3g} kg/m³"
        )
        return InertiaFinding(name, "implausible", sentence, None)
    radius = math.sqrt(high / mass)
    if half > 0.0 and radius > MAX_GYRATION_RADIUS * half:
        sentence = (
            f"an inertia of {high:.3g} kg·m² at {mass:g} kg is that of something {2 * radius:.2g} m wide; "
            f"the link is {2 * half:.2g} m"
        )
        return InertiaFinding(name, "implausible", sentence, None)
    return None


def _remedy(instead: gripper_mounting.LinkInertia, density: float) -> str:
    by = f"of its hull at {density:.4g} kg/m³" if density else "of a ball of 10 g"
    return f": it gets {instead.mass:.3g} kg, {by}, a guess"


def lightened(
    findings: tuple[InertiaFinding, ...], inertias: Mapping[str, gripper_mounting.LinkInertia], share: float
) -> tuple[tuple[InertiaFinding, ...], dict[str, gripper_mounting.LinkInertia]]:
    """Return findings and inertias with the guessed densities reduced to a share of theirs, 0 … 1.

    The share of a motor's rotor in an inertia does not change.
    """
    found: list[InertiaFinding] = []
    lighter = dict(inertias)
    for finding in findings:
        heavy = finding.instead
        if heavy is None or not finding.density:
            found.append(finding)
            continue
        density = share * finding.density
        light = _times(heavy, share)
        sentence = finding.sentence.partition(": it gets ")[0] + _remedy(light, density)
        sentence += ", light enough for the torques of the URDF"
        found.append(replace(finding, sentence=sentence, instead=light, density=density))
        used = inertias[finding.link]
        lighter[finding.link] = light if used == heavy else replace(used, mass=light.mass)
    return tuple(found), lighter


def _times(inertia: gripper_mounting.LinkInertia, share: float) -> gripper_mounting.LinkInertia:
    moments = vector3(max(share * moment, MIN_MOMENT) for moment in inertia.moments)
    products = vector3(share * product for product in inertia.products)
    return replace(inertia, mass=share * inertia.mass, moments=moments, products=products)


def rotor_inertias(
    root: ElementTree.Element,
    skeleton: urdf_parser.UrdfTree,
    joints: Iterable[str],
    known: Mapping[str, gripper_mounting.LinkInertia],
) -> dict[str, gripper_mounting.LinkInertia]:
    """Return raised inertias of a linkage's links whose moments are below that of the motor's rotor.

    `joints`: those of the linkage. `known`: inertias that replace the URDF's.
    """
    links = {link.get("name", ""): link for link in root.findall("link")}
    found: dict[str, gripper_mounting.LinkInertia] = {}
    for name in joints:
        link = skeleton.joints[name].child
        inertia = known.get(link) or read_inertia(links[link])
        if (
            inertia is not None
            and min(inertia.moments) < MIN_LINKAGE_MOMENT
            and skeleton.joints[name].type != "prismatic"
        ):
            x, y, z = (max(m, MIN_LINKAGE_MOMENT) for m in inertia.moments)
            found[link] = gripper_mounting.LinkInertia(inertia.mass, inertia.com, (x, y, z), (0.0, 0.0, 0.0))
    return found


def _read(link: ElementTree.Element) -> tuple[float, Vector3, Array] | None:
    """Return mass, kg, centre, m, and inertia (3, 3), kg·m², in the link's axes; None without a number."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass, inertia, origin = inertial.find("mass"), inertial.find("inertia"), inertial.find("origin")
    try:
        weight = float(mass.get("value", "")) if mass is not None else 0.0
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        numbers = [float(inertia.get(key, "0")) if inertia is not None else 0.0 for key in keys]
        pose = urdf_parser.origin_pose(origin)
    except ValueError:
        return None
    if not all(map(math.isfinite, (weight, *numbers))):
        return None
    ixx, ixy, ixz, iyy, iyz, izz = numbers
    local = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    turned = pose.rotation()
    return weight, pose.position, turned @ local @ turned.T


def read_inertia(link: ElementTree.Element) -> gripper_mounting.LinkInertia | None:
    """Return the inertia that the URDF gives a link; None when it has none that can be read."""
    inertia = _read(link)
    return None if inertia is None else _inertia(*inertia)


def _from_solid(solid: LinkGeometry | None) -> gripper_mounting.LinkInertia:
    if solid is None:
        return gripper_mounting.LinkInertia(0.01, (0.0, 0.0, 0.0), (1e-6, 1e-6, 1e-6), (0.0, 0.0, 0.0))
    return _scaled(solid, max(DEFAULT_DENSITY * solid.volume(), 0.001))


def _scaled(solid: LinkGeometry, mass: float) -> gripper_mounting.LinkInertia:
    """Return the inertia of a box around the link with a given mass, kg."""
    low, high = solid.points.min(axis=0), solid.points.max(axis=0)
    x, y, z = vector3(high - low)
    squares = (y * y + z * z, x * x + z * z, x * x + y * y)
    moments = vector3(max(mass * square / 12, MIN_MOMENT) for square in squares)
    return gripper_mounting.LinkInertia(mass, vector3((low + high) / 2), moments, (0.0, 0.0, 0.0))


def _inertia(mass: float, com: Vector3, m: Array) -> gripper_mounting.LinkInertia:
    return gripper_mounting.LinkInertia(mass, com, vector3(np.diag(m)), vector3((m[0, 1], m[0, 2], m[1, 2])))
