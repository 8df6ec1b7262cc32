"""Which item a fault is meant for, and what is done to it for good."""

from __future__ import annotations

import math
from collections.abc import Callable

from ...world.journal import Plain
from ...world.values import Vector3
from ..fault_files.item_entries import Bump, Friction, Heavier, ItemFault, Larger, Remove, Target
from ..scoring.truth import TrueBody
from .fault_interface import Faulty


def choose(
    hardware: Faulty, target: Target, node: str, object_place: Callable[[str], Vector3 | None]
) -> TrueBody | None:
    """The item that is meant; `object_place` tells where the belief has the object of a node."""
    fitting = [
        body
        for number, body in enumerate(hardware.truth())
        if body.present
        and target.index in (None, number)
        and target.kind in (None, body.kind)
        and target.form in (None, body.form)
        and target.colour in (None, body.colour)
    ]
    match target.nearest_to:
        case "tool":
            near = hardware.true_tcp().position
        case "object":
            near = object_place(node)
        case None:
            near = None
    if near is None:
        return fitting[0] if fitting else None
    return min(fitting, key=lambda body: math.dist(body.pose.position, near), default=None)


def told_of(fault: ItemFault, body: TrueBody) -> dict[str, Plain]:
    """For the record, beside the sentence."""
    data: dict[str, Plain] = {"fault": fault.name, "item": body.id, "kind": body.kind}
    data["colour"] = body.colour
    match fault:
        case Remove():
            pass
        case Friction(friction=friction, mass=mass):
            data |= {"friction": friction, "mass": mass}
        case Bump(velocity=velocity, spin=spin):
            data |= {"velocity": list(velocity), "spin": list(spin)}
        case Heavier(mass=mass):
            data["mass"] = mass
        case Larger(factor=factor):
            data["factor"] = factor
    return data


def carry_out(fault: ItemFault, body: TrueBody, hardware: Faulty) -> str | None:
    """What was done, in words; None: there is no room for it now."""
    match fault:
        case Remove():
            hardware.remove(body.id)
            return f"{body.id} is snatched away"
        case Friction(friction=friction, mass=mass):
            hardware.change_dynamics(body.id, friction, mass)
            message = f"{body.id} has friction {friction:g} now"
            return message + (f" and weighs {mass:g} kg" if mass is not None else "")
        case Bump(velocity=velocity, spin=spin):
            hardware.bump(body.id, velocity, spin)
            return f"{body.id} is bumped to {math.hypot(*velocity):.2f} m/s"
        case Heavier(mass=mass):
            hardware.change_dynamics(body.id, None, mass)
            return f"{body.id} weighs {mass:g} kg now"
        case Larger(factor=factor):
            return (
                f"{body.id} is {factor:g} times as large now" if hardware.enlarge(body.id, factor) else None
            )
