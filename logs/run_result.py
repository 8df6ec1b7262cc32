"""Result of a run: one value, as text and as JSON."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from picktree.files import PicktreeError
from picktree.robot import operator_desk
from picktree.world import FormCount, ItemCount, Plain

from .episode_counts import CureCount, PlantedCount, cause_lines, planted_lines
from .operator_figures import FigureCounts, OperatorFigures

RunStatus: TypeAlias = Literal[
    "success", "incomplete", "failure", "timeout", "paused", "interrupted", "stopped"
]

_SENTENCES: Mapping[RunStatus, str] = {
    "success": "the goal is reached",
    "incomplete": "the tree ended in SUCCESS, but the goal is missed",
    "failure": "the tree ended in FAILURE",
    "timeout": "the run was ended at its limit of simulated time",
    "paused": "it waits for help",
    "interrupted": "the run was interrupted",
    "stopped": "the robot's own side ended the run",
}


@dataclass(frozen=True, slots=True)
class PickCount:
    """Number of grasps, as the robot measured them."""

    tried: int
    """Number of times that the fingers closed on an object."""
    held: int
    objects: int
    """Number of different objects that were tried."""
    held_first_try: int
    """Number of objects that were held when the fingers first closed on them."""


@dataclass(frozen=True, slots=True)
class FeedCount:
    """Counters of the feed, for a scene with one."""

    deliveries: int
    """Number of loads that have come."""
    exchanges: int
    """Number of bins that were exchanged for empty ones."""
    set_aside: int
    """Number of items that the mission gave up at their place."""


@dataclass(frozen=True, slots=True)
class HoleItem:
    """Item that ended at a hole of a fixture, as the scorer measured it."""

    item: str
    kind: str
    hole: str
    verdict: str
    depth: float
    """Depth of the item's lowest point below the hole's mouth, m."""
    bottom: float
    """Depth of the hole, m."""
    tilt: float
    """Angle between the axes of item and hole, rad."""
    penetration: float
    """Maximum penetration of item and fixture within the last second, m."""
    reason: str
    """Reason why the item does not count as in the hole, or as at its destination; empty when it does."""

    def to_text(self) -> str:
        """Return a line for a terminal."""
        measured = (
            f"{1000 * self.depth:.1f} of {1000 * self.bottom:.1f} mm deep, leans "
            f"{math.degrees(self.tilt):.1f} deg, {1000 * self.penetration:.3f} mm in the wall"
        )
        text = self.verdict + (f": {self.reason}" if self.reason else "")
        return f"{self.kind} in {self.hole}: {measured}; {text}"


@dataclass(frozen=True, slots=True)
class CrushedItem:
    """Item that a finger crushed; it counts as misplaced."""

    item: str
    kind: str
    colour: str
    force: float
    """Force of the finger, N."""
    limit: float
    """Force that the item bears, N."""

    def to_text(self) -> str:
        """Return a line for a terminal."""
        pressed = f"a finger pressed with {self.force:.0f} N, and the item withstands {self.limit:g} N"
        return f"{self.item}, a {self.colour} {self.kind}: {pressed}"


@dataclass(frozen=True, slots=True)
class WallSeconds:
    """Wall time by part, s; the parts do not sum up to the total."""

    total: float
    physics: float
    planning: float
    perception: float
    logging: float


@dataclass(frozen=True, slots=True)
class RunResult:
    """Result of one run. Except for wall and CPU times and paths, it follows from the request."""

    status: RunStatus
    seed: int
    digest: str
    """SHA-256 over all simulated content, in hex."""
    items: ItemCount
    picks: PickCount
    sim_seconds: float
    cpu_seconds: float
    wall_seconds: WallSeconds
    log: Path
    folder: Path
    """Folder of the run: the log, the result, reports."""
    failures: Mapping[str, int] = field(default_factory=dict[str, int])
    """Number of failures of leaves by cause."""
    recoveries: Mapping[str, int] = field(default_factory=dict[str, int])
    """Number of handler runs by cause, as `Recover` and `RecoveryNode` announce them.

    An episode may have several. The next branch of a `Fallback` and a mere retry do not count.
    """
    cures: tuple[CureCount, ...] | None = None
    """Episodes counted by cause and cure, in the terms of `episodes.episode`; None in older logs."""
    planted: tuple[PlantedCount, ...] = ()
    """Injected faults, counted with the first failure after them."""
    message: str = ""
    """Sentence on why the tree failed; empty when it did not."""
    thinking_charged: bool = True
    """Whether planning and perception took simulated time."""
    disagreements: int | None = None
    """Number of trajectories that the verifier has rejected; None: it was not in use."""
    feed: FeedCount | None = None
    """Counters of the feed; None for a scene without one."""
    holes: tuple[HoleItem, ...] = ()
    """Items that ended at holes."""
    crushed: tuple[CrushedItem, ...] = ()
    """Items that fingers crushed."""
    asked: operator_desk.OperatorQuestion | None = None
    """Question to a person, for a paused run; else None."""
    as_believed: bool = False
    """Whether `items` counts what the robot believes: a run on a robot has no ground truth."""
    figures: FigureCounts | None = None
    """Counts of the operators' figures; None in older logs."""

    @property
    def operator_figures(self) -> OperatorFigures | None:
        """Operators' figures with their intervals; None in older logs."""
        return None if self.figures is None else OperatorFigures((self.figures,))

    @property
    def reached(self) -> bool:
        """Whether the tree ended in SUCCESS and the goal is reached."""
        return self.status == "success"

    @property
    def seconds_per_pick(self) -> float | None:
        """Simulated seconds for each held object; None without a held object."""
        return self.sim_seconds / self.picks.held if self.picks.held else None

    def explain_command(self, program: str = "picktree") -> str:
        """Return the command that explains the run; `program` is the name by which picktree is called
        here."""
        return f"{program} explain {shlex.quote(str(self.folder))}"

    def resume_command(self, program: str = "picktree") -> str:
        """Return the command that resumes a paused run, with the first of the question's choices as
        answer."""
        answer = f" --answer {shlex.quote(self.asked.choices[0])}" if self.asked else ""
        return f"{program} run --resume {shlex.quote(str(self.folder))}{answer}"

    def to_json(self) -> dict[str, Plain]:
        picks, by_form = self.picks, dict(sorted(self.items.by_form.items()))
        return {
            "status": self.status,
            "message": self.message,
            "seed": self.seed,
            "digest": self.digest,
            "items": asdict(replace(self.items, by_form=by_form)),
            "picks": {
                "tried": picks.tried,
                "held": picks.held,
                "held_first_try": picks.held_first_try,
                "objects": picks.objects,
            },
            "failures": dict(sorted(self.failures.items())),
            "recoveries": dict(sorted(self.recoveries.items())),
            "cures": None if self.cures is None else [asdict(each) for each in self.cures],
            "planted": [asdict(each) for each in self.planted],
            "sim_seconds": round(self.sim_seconds, 6),
            "thinking_charged": self.thinking_charged,
            "disagreements": self.disagreements,
            "feed": None if self.feed is None else asdict(self.feed),
            "holes": [asdict(item) for item in self.holes],
            "crushed": [asdict(item) for item in self.crushed],
            "asked": None if self.asked is None else self.asked.to_json(),
            **({"as_believed": True} if self.as_believed else {}),
            "figures": self._figures_json(),
            "cpu_seconds": round(self.cpu_seconds, 3),
            "wall_seconds": {part: round(wall, 3) for part, wall in asdict(self.wall_seconds).items()},
            "log": str(self.log.absolute()),
            "folder": str(self.folder.absolute()),
        }

    def to_json_text(self) -> str:
        """Return one JSON object, with a trailing newline."""
        return json.dumps(self.to_json(), ensure_ascii=False, indent=2, allow_nan=False) + "\n"

    @classmethod
    def from_json_text(cls, text: str, source: Path) -> RunResult:
        """Parse the text of `to_json_text` from the log `source`. Raises PicktreeError when it is something
        else."""
        try:
            values = json.loads(text)
            wall = values["wall_seconds"]
            items = dict(values["items"])
            forms = {form: FormCount(**count) for form, count in items.pop("by_form").items()}
            return cls(
                items=ItemCount(**items, by_form=forms),
                picks=PickCount(**values["picks"]),
                wall_seconds=WallSeconds(**wall),
                feed=FeedCount(**values["feed"]) if values.get("feed") else None,
                cures=_cures(values.get("cures")),
                planted=tuple(PlantedCount(**each) for each in values.get("planted", ())),
                holes=tuple(HoleItem(**item) for item in values.get("holes", ())),
                crushed=tuple(CrushedItem(**item) for item in values.get("crushed", ())),
                asked=operator_desk.OperatorQuestion.from_json(values["asked"])
                if values.get("asked")
                else None,
                as_believed=bool(values.get("as_believed", False)),
                figures=FigureCounts.from_json(values["figures"]) if values.get("figures") else None,
                log=Path(values["log"]),
                folder=Path(values["folder"]),
                **{name: values[name] for name in _PLAIN_FIELDS},
            )
        except (ValueError, KeyError, TypeError) as error:
            raise PicktreeError(f"{source}: the result in the log is unreadable: {error!r}") from None

    def to_text(self, program: str = "picktree") -> str:
        """Return the summary for a terminal, without a trailing newline; `program` as for commands."""
        items, picks, wall = self.items, self.picks, self.wall_seconds
        lines = [
            f"{self.status}: {_SENTENCES[self.status]}" + (f": {self.message}" if self.message else ""),
            *self._waits(program),
            f"items       {items.to_text()}{', as the robot believes' if self.as_believed else ''}",
        ]
        lines += [
            f"  {form:<10}{count.sorted} of {count.total}" for form, count in sorted(items.by_form.items())
        ]
        lines += [
            *(f"{'holes' if n == 0 else '':<12}{item.to_text()}" for n, item in enumerate(self.holes)),
            *(f"{'crushed' if n == 0 else '':<12}{item.to_text()}" for n, item in enumerate(self.crushed)),
            f"grasps      {picks.tried} tried, {picks.held} held; "
            f"{picks.held_first_try} of {picks.objects} objects held at the first try",
            f"failures    {_counts(self.failures)}",
            *self._recovered(),
            *self._fed(),
            *self._verified(),
            *self._figures(),
            f"simulated   {self.sim_seconds:.1f} s{self._rate()}{self._thinking()}",
            f"wall        {wall.total:.1f} s: physics {wall.physics:.1f}, planning {wall.planning:.1f}, "
            f"perception {wall.perception:.1f}, logging {wall.logging:.1f}; CPU {self.cpu_seconds:.1f} s",
            f"seed        {self.seed}, digest {self.digest[:16]}",
            f"log         {self.log.absolute()}",
            f"look at it  {self.explain_command(program)}",
        ]
        return "\n".join(lines)

    def _waits(self, program: str) -> list[str]:
        """Return the lines about a person's answer; empty when the run does not wait for one."""
        if self.asked is None:
            return []
        return [
            f"it is so    {self.asked.situation}",
            f"answers     {', '.join(self.asked.choices)}",
            f"resume with {self.resume_command(program)}",
        ]

    def _recovered(self) -> list[str]:
        """Return a line for each cause, with the most time lost first."""
        if self.cures is None:
            return [f"recoveries  {_counts(self.recoveries)}"]  # an older log: handler runs only
        lines = _under("recovery", cause_lines(self.cures))
        return [*lines, *_under("planted", planted_lines(self.planted))]

    def _fed(self) -> list[str]:
        """Return a line when the scene has a feed."""
        if self.feed is None:
            return []
        feed = self.feed
        parts = (
            (feed.deliveries, "delivery", "deliveries"),
            (feed.exchanges, "bin exchanged", "bins exchanged"),
            (feed.set_aside, "item set aside", "items set aside"),
        )
        return ["feed        " + ", ".join(f"{n} {one if n == 1 else more}" for n, one, more in parts)]

    def _figures(self) -> list[str]:
        figures = self.operator_figures
        return [] if figures is None else [f"{title:<12}{text}" for title, text in figures.lines()]

    def _figures_json(self) -> dict[str, Plain] | None:
        figures = self.operator_figures
        return None if self.figures is None or figures is None else self.figures.to_json() | figures.to_json()

    def _verified(self) -> list[str]:
        """Return a line when the verifier was in use."""
        if self.disagreements is None:
            return []
        return [f"verified    the second checker disagreed on {self.disagreements} trajectories"]

    def _rate(self) -> str:
        rate = self.seconds_per_pick
        return "" if rate is None else f", {rate:.1f} s a pick"

    def _thinking(self) -> str:
        return "" if self.thinking_charged else " (planning and perception took no simulated time)"


_PLAIN_FIELDS = (
    "status", "seed", "digest", "sim_seconds", "cpu_seconds", "failures", "recoveries", "message",
    "thinking_charged", "disagreements",
)  # fmt: skip


def _cures(counts: list[dict[str, Any]] | None) -> tuple[CureCount, ...] | None:
    if counts is None:
        return None
    found = (CureCount(**each) for each in counts)
    return tuple(replace(each, failed_before=tuple(each.failed_before)) for each in found)


def _under(title: str, lines: Iterable[str]) -> list[str]:
    """Return the lines, the first with the title before it."""
    return [f"{title if n == 0 else '':<12}{line}" for n, line in enumerate(lines)]


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {number}" for name, number in sorted(counts.items())) or "none"
