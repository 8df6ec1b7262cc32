"""Faults of a URDF's links, joints and inertials. Geometry is checked where it is read."""

from __future__ import annotations

import difflib
import math
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from picktree.files import describe, listed, suggest_name

LIMITED = ("revolute", "prismatic")
MOVING = ("revolute", "continuous", "prismatic")
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MAX_ANGLE = 20.0
"""Greatest angle that counts as radians, three turns; more looks like degrees."""
MAX_DEGREES = 900.0
"""Greatest limit that looks like degrees; more means a joint that turns without end, rad."""
MAX_OFFSET = 50.0
"""Greatest offset of a joint that counts as metres; more looks like millimetres."""
MIN_TAG_LIKENESS = 0.85
"""Least likeness of a misspelt element to a known one, as difflib measures it."""
MAX_HINTS = 8
"""Greatest number of known names that a fault lists."""
MAX_FAULTS = 20
"""Greatest number of faults that are reported of one file."""


class UrdfError(ValueError):
    """URDF that cannot be used. Each of its `faults` is one sentence."""

    def __init__(self, *faults: str) -> None:
        self.faults = faults
        super().__init__("; ".join(faults))


def urdf_faults(root: ElementTree.Element) -> tuple[str, ...]:
    """Return all faults of a parsed URDF, each as one sentence; none for a usable robot.

    A robot needs no name, and a joint may have the name of a link.
    """
    if root.tag != "robot":
        return (f"the outermost element is <{root.tag}>, not <robot>",)
    found = [*_name_faults(root), *_tag_faults("the robot", root)]
    for link in root.findall("link"):
        found += _tag_faults(f"link {describe(link.get('name', ''))}", link)
        found += _inertial_faults(link)
    for joint in root.findall("joint"):
        found += _tag_faults(f"joint {describe(joint.get('name', ''))}", joint)
        found += _joint_faults(joint)
    found += _mimic_faults(root)
    found = found or [*_holder_faults(root)] or [*_ring_faults(root)]
    if len(found) > MAX_FAULTS:
        found = [*found[: MAX_FAULTS - 1], f"{len(found) - MAX_FAULTS + 1} more faults"]
    return tuple(found)


def number_of(text: str | None) -> float | None:
    """Return the finite number that an attribute gives, None for anything else."""
    if text is None or not _NUMBER.fullmatch(text.strip()):
        return None
    number = float(text)
    return number if math.isfinite(number) else None


def numbers_of(text: str) -> tuple[float, ...] | None:
    """Return the finite numbers that an attribute gives between spaces, None for anything else."""
    numbers = [number_of(word) for word in text.split()]
    return None if None in numbers else tuple(number for number in numbers if number is not None)


_TAGS: Mapping[str, tuple[str, ...]] = {
    "robot": ("link", "joint"),
    "link": ("inertial", "visual", "collision"),
    "joint": ("origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "safety_controller"),
}
"""Elements of a robot, a link and a joint that are read."""
_SINGLE = frozenset(("inertial", *_TAGS["joint"]))
"""Those of a link or a joint that are there once."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_COMMA = re.compile(r"(?<=\d),(?=\d)")
_UNIT = re.compile(
    r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(deg|degrees?|°|rad|mm|cm|m|kg|g)", re.ASCII
)
_SCALES = {"mm": 1e-3, "cm": 1e-2, "g": 1e-3, "°": math.pi / 180}


def _name_faults(root: ElementTree.Element) -> Iterator[str]:
    for tag in ("link", "joint"):
        named = [element.get("name", "") for element in root.findall(tag)]
        for n, name in enumerate(named):
            if not name.strip():
                behind = f"behind {named[n - 1]!r}" if n and named[n - 1] else f"number {n + 1} of the file"
                yield f"the <{tag}> {behind} has no name"
        for name, count in Counter(named).items():
            if count > 1 and name:
                yield f"{count} {tag}s have the name {describe(name)}; give each a name of its own"
            if name == "universe" and tag == "joint":
                yield "joint 'universe' has the name of the world; give it another one"
    if not root.findall("link"):
        yield "<robot> has no <link>"


def _tag_faults(where: str, element: ElementTree.Element) -> Iterator[str]:
    """Report elements with a misspelt name, which no reader takes, and doubled ones. Other unknown elements
    are of other tools."""
    known = _TAGS[element.tag]
    present = {child.tag for child in element}
    for tag in sorted(present.difference(known)):
        meant = difflib.get_close_matches(tag.lower(), known, n=1, cutoff=MIN_TAG_LIKENESS)
        if meant and (meant[0] not in present or tag.lower() == meant[0]):
            yield f"{where}: <{tag}> is not read; write <{meant[0]}>"
    for tag in (tag for tag in known if tag in _SINGLE):
        if (count := len(element.findall(tag))) > 1:
            yield f"{where} has {count} <{tag}>; keep one"


def _inertial_faults(link: ElementTree.Element) -> Iterator[str]:
    where, inertial = f"link {describe(link.get('name', ''))}", link.find("inertial")
    if inertial is None:
        return
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    yield from origin_faults(where, inertial.find("origin"))
    if mass is None:
        yield f'{where}: <inertial> has no <mass>; write it in kg, as <mass value="1.5"/>'
    else:
        yield from number_faults(where, mass, "value", "kg", least=0.0)
    if inertia is None:
        return
    for key in ("ixx", "iyy", "izz"):
        yield from number_faults(where, inertia, key, "kg·m²")
    for key in ("ixy", "ixz", "iyz"):
        yield from number_faults(where, inertia, key, "kg·m²", needed=False)


def _joint_faults(joint: ElementTree.Element) -> Iterator[str]:
    where, kind = f"joint {describe(joint.get('name', ''))}", joint.get("type")
    if kind is None:
        yield f"{where} has no type; known: {', '.join(JOINT_TYPES)}"
    elif kind not in JOINT_TYPES:
        yield f"{where} has the type {describe(kind)}, which is no joint type{_hint(kind, JOINT_TYPES)}"
    for end in ("parent", "child"):
        element = joint.find(end)
        if element is None or not element.get("link"):
            yield f'{where} has no {end}; name it, as <{end} link="link_1"/>'
    yield from origin_faults(where, joint.find("origin"))
    if kind in (*MOVING, "planar"):
        yield from _axis_faults(where, joint.find("axis"))
    if kind in MOVING:
        yield from _limit_faults(where, kind, joint.find("limit"))
    if (soft := joint.find("safety_controller")) is not None:
        for key in ("soft_lower_limit", "soft_upper_limit"):
            yield from number_faults(where, soft, key, _unit(kind), needed=False)
    if (dynamics := joint.find("dynamics")) is not None:
        for key in ("damping", "friction"):
            yield from number_faults(where, dynamics, key, "SI units", needed=False, least=0.0)
    if (mimic := joint.find("mimic")) is not None:
        yield from number_faults(where, mimic, "multiplier", "", needed=False)
        yield from number_faults(where, mimic, "offset", _unit(kind), needed=False)


def _unit(kind: str | None) -> str:
    return "m" if kind == "prismatic" else "rad"


def _axis_faults(where: str, axis: ElementTree.Element | None) -> Iterator[str]:
    if axis is None or axis.get("xyz") is None:
        return
    text = axis.get("xyz", "")
    faults = [*vector_faults(where, axis, "xyz")]
    yield from faults
    if not faults and not any(numbers_of(text) or ()):
        yield f'{where}: <axis xyz="{text}"> has no direction; write that of its motion, as xyz="0 0 1"'


def _limit_faults(where: str, kind: str, limit: ElementTree.Element | None) -> Iterator[str]:
    if limit is None:
        if kind in LIMITED:
            unit = "0.04" if kind == "prismatic" else "3"
            yield (
                f"{where} is {kind} and has no <limit>; write it, as "
                f'<limit lower="-{unit}" upper="{unit}" effort="50" velocity="2"/>'
            )
        return
    rate = "m/s" if kind == "prismatic" else "rad/s"
    yield from number_faults(
        where, limit, "effort", "N" if kind == "prismatic" else "Nm", needed=kind in LIMITED
    )
    yield from number_faults(where, limit, "velocity", rate, needed=kind in LIMITED)
    if kind not in LIMITED:
        return
    for key in ("lower", "upper"):
        yield from number_faults(where, limit, key, _unit(kind), needed=False)
    lower, upper = number_of(limit.get("lower", "0")), number_of(limit.get("upper", "0"))
    if lower is None or upper is None:
        return
    if lower > upper:
        yield f"{where}: the lower limit, {lower:g}, is above the upper, {upper:g}: are they swapped?"
    most = max(abs(lower), abs(upper))
    if kind == "revolute" and MAX_ANGLE < most <= MAX_DEGREES:
        yield (
            f"{where}: limits of {lower:g} … {upper:g} rad: are they degrees? Write "
            f"{math.radians(lower):.4g} … {math.radians(upper):.4g}"
        )


def origin_faults(where: str, origin: ElementTree.Element | None) -> Iterator[str]:
    """Yield the faults of an <origin>, if there is one."""
    if origin is None:
        return
    for key, most, wrong_unit in (("xyz", MAX_OFFSET, "millimetres"), ("rpy", MAX_ANGLE, "degrees")):
        if (text := origin.get(key)) is None:
            continue
        faults = [*vector_faults(where, origin, key)]
        yield from faults
        if not faults and max(map(abs, numbers_of(text) or (0.0,))) > most:
            scale, unit = (1e-3, "m") if key == "xyz" else (math.pi / 180, "rad")
            right = " ".join(f"{scale * number:.6g}" for number in numbers_of(text) or ())
            yield f'{where}: <origin {key}="{text}"> is in {unit}: are these {wrong_unit}? Write "{right}"'


def vector_faults(
    where: str, element: ElementTree.Element, key: str, example: str = "0 0 1"
) -> Iterator[str]:
    """Yield the faults of an attribute of three numbers; `example`: a valid one."""
    text = element.get(key, "")
    numbers = numbers_of(text)
    if numbers is not None and len(numbers) == 3:
        return
    here = f'{where}: <{element.tag} {key}="{_shortened(text)}">'
    if numbers is not None:
        count = "1 number" if len(numbers) == 1 else f"{len(numbers)} numbers"
        yield f'{here} has {count}, not three; write it as {key}="{example}"'
    elif (right := numbers_of(text.replace(",", " "))) and len(right) == 3:
        yield f'{here} has commas; write "{" ".join(f"{number:g}" for number in right)}"'
    else:
        words = [word for word in text.split() if number_of(word) is None]
        yield f"{here} {_misread(words[0], '')}"


def number_faults(
    where: str,
    element: ElementTree.Element,
    key: str,
    unit: str,
    *,
    needed: bool = True,
    least: float | None = None,
) -> Iterator[str]:
    """Yield the faults of an attribute of one number in `unit`."""
    text = element.get(key)
    if text is None:
        if needed:
            yield f"{where}: <{element.tag}> has no {key}; write it, in {unit}"
        return
    number = number_of(text)
    here = f'{where}: <{element.tag} {key}="{_shortened(text)}">'
    if number is None:
        yield f"{here} {_misread(text, unit)}"
    elif least is not None and number < least:
        yield f"{here} is less than {least:g}"


def _misread(text: str, unit: str) -> str:
    """Return the second half of a sentence: the text in place of a number, and a remedy."""
    plain = text.strip()
    within = f", in {unit}" if unit else ""
    if not plain:
        return f"is empty; write a number{within}"
    if "${" in plain or "$(" in plain:
        return "is a xacro expression; expand the file with `xacro`"
    if (right := number_of(_COMMA.sub(".", plain, count=1))) is not None:
        return f"has a decimal comma; write {right:g}"
    if (pieces := _UNIT.fullmatch(plain)) is not None:
        scale = math.pi / 180 if pieces[2].startswith("deg") else _SCALES.get(pieces[2], 1.0)
        return f"has a unit; write {float(pieces[1]) * scale:.4g}{within}"
    try:
        float(plain)
    except ValueError:
        return f"is no number; write one{within}"
    return f"is no finite number; write one{within}"


def _shortened(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def _mimic_faults(root: ElementTree.Element) -> Iterator[str]:
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    follows: dict[str, str] = {}
    for name, joint in joints.items():
        mimic, where = joint.find("mimic"), f"joint {describe(name)}"
        if mimic is None or joint.get("type") not in MOVING:
            continue
        leader = mimic.get("joint", "")
        if not leader:
            yield f'{where}: <mimic> names no joint; name the one that it follows, as joint="finger_joint"'
        elif leader not in joints:
            yield f"{where} mimics {describe(leader)}, which is no joint{_hint(leader, joints)}"
        elif joints[leader].get("type") not in MOVING:
            yield f"{where} mimics {describe(leader)}, which does not move; name a joint that does"
        else:
            follows[name] = leader
    for ring in _rings(follows):
        if len(ring) == 1:
            yield f"joint {describe(ring[0])} mimics itself; name the joint that it follows"
        else:
            yield f"joints {listed(map(describe, ring), 8)} mimic each other in a ring; one must mimic none"


def _holder_faults(root: ElementTree.Element) -> Iterator[str]:
    links = {link.get("name", "") for link in root.findall("link")}
    holders: dict[str, str] = {}
    for joint in root.findall("joint"):
        name, child = joint.get("name", ""), _link_of(joint, "child")
        for end in (_link_of(joint, "parent"), child):
            if end not in links:
                yield (
                    f"joint {describe(name)} holds the link {describe(end)}, which is not there"
                    f"{_hint(end, sorted(links))}"
                )
        if child in holders:
            yield (
                f"link {describe(child)} hangs on two joints, {describe(holders[child])} and "
                f"{describe(name)}; remove one, or name another child"
            )
        holders[child] = name


def _ring_faults(root: ElementTree.Element) -> Iterator[str]:
    parents = {_link_of(joint, "child"): _link_of(joint, "parent") for joint in root.findall("joint")}
    rings = _rings(parents)
    for ring in rings:
        yield f"links {listed(map(describe, ring), 8)} hang on each other in a ring; one must be the base"
    bases = [name for link in root.findall("link") if (name := link.get("name", "")) not in parents]
    if len(bases) != 1 and not rings:
        yield (
            f"one link must be the base of all others, not {len(bases)}: "
            f"{listed(map(describe, bases), 8)}; join them by fixed joints"
        )


def _hint(name: str, known: Iterable[str]) -> str:
    """Return the nearest known name in brackets, or the first of them."""
    names = [*known]
    hint = suggest_name(name, names)
    if hint.startswith("known"):
        hint = f"known: {', '.join(names[:MAX_HINTS])}{', …' if len(names) > MAX_HINTS else ''}"
    return f" ({hint})" if hint else ""


def _link_of(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _rings(follows: Mapping[str, str]) -> list[list[str]]:
    """Return each ring of names in which one leads to the next, once."""
    rings: list[list[str]] = []
    seen: set[str] = set()
    for start in follows:
        path: list[str] = []
        name = start
        while name in follows and name not in seen:
            seen.add(name)
            path.append(name)
            name = follows[name]
        if name in path:
            rings.append(path[path.index(name) :])
    return rings
