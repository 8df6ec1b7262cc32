"""Result of a plan trial: one value, rendered as text and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import degrees

from ...world.causes import Evidence, Failure

MILLIMETRE_KEYS = frozenset({"depth", "by", "short", "at", "point", "first"})
"""Keys of evidence in m that the text gives in mm."""
DEGREE_KEYS = frozenset({"turned", "gets"})
"""Keys of evidence in rad that the text gives in deg."""


@dataclass(frozen=True, slots=True)
class PlanFigures:
    """Figures of a plan; SI units."""

    planner: str
    legs: tuple[str, ...]
    """Planners of a motion chain; empty for a single motion."""
    checks: int
    thinking: float
    """Simulated time charged for planning, s."""
    duration: float
    length: float
    """Path length in joint space, rad."""
    way: float
    """Path length of the tool, m."""
    nearest: tuple[str, str] | None
    """Nearest pair of bodies: of the robot, and around it; None: nothing is near."""
    clearance: float | None
    nearest_at: float | None
    itself: tuple[str, str] | None
    """Nearest pair of the robot's own links."""
    itself_clearance: float | None
    singular: float
    singular_at: float
    joint: str
    """Joint that comes nearest to one of its limits."""
    joint_room: float
    joint_room_at: float
    joint_slides: bool


@dataclass(frozen=True, slots=True)
class PlanRefusal:
    """Reason why there is no plan."""

    cause: str
    message: str
    remedy: str
    evidence: Evidence

    @classmethod
    def of(cls, failure: Failure) -> PlanRefusal:
        """Return the reason that a failure of the planner gives."""
        return cls(failure.cause.name, failure.message, failure.cause.remedy, failure.evidence)


@dataclass(frozen=True, slots=True)
class PlanAnswer:
    """Answer of `picktree plan`."""

    scene: str
    robot: str
    seed: int
    asked: str
    begins: str
    grasp: str = ""
    """Grasp of the object that was planned for."""
    found: PlanFigures | None = None
    refused: PlanRefusal | None = None
    rejected: tuple[str, ...] = ()
    """Reasons why other grasps of the object were rejected."""
    judged: tuple[str, ...] | None = None
    """Objections of the verifier to the plan, with --verify; None: it was not asked."""
    picture: str = ""

    @property
    def good(self) -> bool:
        """Whether there is a plan without objections by the verifier."""
        return self.found is not None and not self.judged

    def to_json_text(self) -> str:
        return json.dumps(asdict(self), indent=2, default=str) + "\n"

    def to_text(self) -> str:
        """Return the answer as text for a terminal."""
        lines = [
            f"{self.asked}, from {self.begins}",
            f"scene {self.scene}, robot {self.robot}, seed {self.seed}; everything is believed where it is",
            "",
            *self.lines(),
        ]
        if self.picture:
            lines += ["", f"picture: {self.picture}"]
        return "\n".join(lines)

    def lines(self) -> list[str]:
        """Return the figures of the plan, or the reason why there is none."""
        if self.found is not None:
            return _table(self._figures(self.found))
        return self._why_not(self.refused) if self.refused is not None else []

    def _figures(self, found: PlanFigures) -> Iterator[tuple[str, str]]:
        if self.grasp:
            yield "grasp", self.grasp
        legs = f" of {', '.join(found.legs)}" if found.legs else ""
        yield "planner", found.planner + legs
        yield "checks", f"{found.checks} ({found.thinking * 1000:.0f} ms of thinking)"
        yield "motion", f"{found.duration:.2f} s, {found.length:.2f} rad, the tool {found.way * 1000:.0f} mm"
        if found.nearest is None or found.clearance is None:
            yield "nearest", "nothing within 500 mm"
        else:
            a, b = found.nearest
            yield "nearest", f"{found.clearance * 1000:.1f} mm: {a} to {b}, at {found.nearest_at:.2f} s"
        if found.itself is not None and found.itself_clearance is not None:
            a, b = found.itself
            yield "itself", f"{found.itself_clearance * 1000:.1f} mm: {a} to {b}"
        yield (
            "singularity",
            f"smallest singular value {found.singular:.3f}, at {found.singular_at:.2f} s",
        )
        room = (
            f"{found.joint_room * 1000:.1f} mm"
            if found.joint_slides
            else f"{degrees(found.joint_room):.1f} deg"
        )
        yield "joint limits", f"{found.joint} comes within {room}, at {found.joint_room_at:.2f} s"
        if self.judged is not None:
            yield "judged", "free by the second checker" if not self.judged else "; ".join(self.judged)

    def _why_not(self, refused: PlanRefusal) -> list[str]:
        lines = [f"no plan: {refused.cause}", f"  {refused.message}", f"  to try: {refused.remedy}"]
        rows = list(_rows(refused.evidence))
        if rows:
            lines += ["", *(f"  {line}" for line in _table(rows))]
        if self.rejected:
            lines += ["", "grasps that were not taken:", *(f"  {one}" for one in self.rejected)]
        return lines


def _rows(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Return the evidence as rows of a table; empty values give none."""
    for key, value in evidence.items():
        name = key.replace("_", " ")
        if isinstance(value, list):
            if value and isinstance(value[0], str):
                for k, one in enumerate(value):
                    yield (name if k == 0 else "", str(one))
            elif value:
                numbers = [float(one) for one in value]
                if key in MILLIMETRE_KEYS:
                    yield name, ", ".join(f"{one * 1000:.1f}" for one in numbers) + " mm"
                else:
                    yield name, ", ".join(f"{one:.3f}" for one in numbers)
        elif key in MILLIMETRE_KEYS and isinstance(value, float):
            yield name, f"{value * 1000:.1f} mm"
        elif key in DEGREE_KEYS and isinstance(value, float):
            yield name, f"{degrees(value):.1f} deg"
        elif isinstance(value, float):
            yield name, f"{value:.4g}"
        elif value not in ("", None):
            yield name, str(value)


def _table(rows: Iterator[tuple[str, str]] | list[tuple[str, str]]) -> list[str]:
    listed = list(rows)
    wide = max(len(name) for name, _ in listed)
    return [f"{name:<{wide}}  {text}" for name, text in listed]
