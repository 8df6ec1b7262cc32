"""Experiments that take a root cause away: the parts of the simulation that are nominal then, or the settings
of the mission that are corrected.

An experiment follows from the words of the root cause alone: its code, item, device, body, node and time.
No faults file, fault event or label is read. The ground truth gives the numbers of items and the names of
bodies.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from picktree.files import PicktreeError, listed
from picktree.logs import RunRecord

from .case import Investigation
from .explanation import Explanation, FailureStory, RootCause
from .run_explanation import failures_of, has_truth, investigation
from .wording import seconds

Fact: TypeAlias = str
"""Outcome of a run in coarse words: `goal`, `item item_03`, or `failure grasp Grasp red_can`."""
GOAL: Final = "goal"


def failure_fact(cause: str, skill: str, item: str) -> Fact:
    """Return a failure as an outcome: family of its cause, skill, and item without its number."""
    words = ("failure", cause.partition(".")[0], skill, re.sub(r"_\d+$", "", item))
    return " ".join(filter(None, words))


@dataclass(frozen=True, slots=True)
class Removal:
    """Change of a continuation that takes a root cause away."""

    sentence: str
    nominal: tuple[str, ...] = ()
    """Parts of the simulation that are nominal, as `whatif --nominal` takes them."""
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    """Ports of the mission, as `whatif --set` takes them."""
    look: str = ""
    """Camera of a look with which the mission begins; empty: no look is added."""
    longer: bool = False
    """Whether the time limit of the run does not count."""
    is_state: bool = True
    """Whether the cause is a state of the part. The removal of a state that was nominal refutes the cause.
    The removal of an event that something else brought about shows nothing."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Question whether a root cause has caused its outcome, with the way to take the cause away."""

    number: int
    """Place of the root cause among those of the run, from 1; 0: it is not among them."""
    root: RootCause
    removal: Removal | None
    """None: no way to take it away is known."""
    advice: str
    """Experiment that a person could make; empty with a removal."""
    since: float
    """Time before which the cause had no effect, simulated s."""
    last: float
    """Time of the last failure of the cause, or of the cause itself, simulated s. The end of the run without
    both."""
    facts: tuple[Fact, ...]
    """Outcomes that the cause is to have had, of which the first is the costliest."""
    names: Mapping[Fact, str]
    """Outcomes in words."""


_PART_OF_ITEM: Final = {
    "item.heavy": ("mass", "has the mass of the catalogue"),
    "item.slippery": ("friction", "has the friction of the catalogue"),
    "item.slipped": ("friction", "has the friction of the catalogue"),
    "item.larger": ("size", "has the size of the catalogue"),
    "item.gone": ("place", "is not taken away"),
    "item.moved": ("place", "is moved by the robot alone"),
    "item.struck": ("place", "is moved by the robot alone"),
    "item.left_bin": ("place", "is moved by the robot alone"),
}
_EVENTS: Final = frozenset({"item.slipped", "item.gone", "item.moved", "item.struck", "item.left_bin"})
"""Causes that are events: other bodies may have moved the item, too, and stay."""
_DEVICES: Final = {
    "gripper.jammed": ("gripper", "the gripper moves and has all its force"),
    "gripper.weak": ("gripper", "the gripper moves and has all its force"),
    "wrist.silent": ("wrist", "the wrist sensor is nominal"),
    "wrist.biased": ("wrist", "the wrist sensor is nominal"),
    "safety.stale_sensor": ("wrist", "the wrist sensor is nominal"),
    "arm.stalled": ("arm", "the arm's drives take commands"),
    "planner.refuses": ("planner", "the planner answers"),
    "perception.mistaken": ("camera", "the cameras are nominal"),
    "item.appeared": ("arrivals", "no further item appears"),
}
_BODIES: Final = frozenset(
    {"scene.unknown_obstacle", "scene.blocked", "contact.obstacle", "perception.phantom"}
)
_SKILLS: Final = frozenset({"skill.hangs", "internal.error"})
_ADVICE: Final = (
    ("bin.", "empty or move the bin in a copy of the scene, and run `picktree resim LOG --scene FILE`"),
    ("scene.", "take the body out of a copy of the scene, and run `picktree resim LOG --scene FILE`"),
    ("item.", "put the item elsewhere in a copy of the scene, and run `picktree resim LOG --scene FILE`"),
    ("heap.", "fill the tote otherwise in a copy of the scene, and run `picktree resim LOG --scene FILE`"),
    ("run.", "continue the run with `picktree run --resume LOG`"),
    ("", "correct the mission in a copy, and continue with `picktree whatif LOG --at TIME --mission FILE`"),
)
"""Experiments that a person could make, by the beginning of the cause."""


def experiment(run: RunRecord, found: Explanation, cause: str | RootCause = "1") -> Experiment:
    """Return the experiment about a root cause: its place, from 1, its code, or a root cause of your own.

    Raises PicktreeError when the run has no such root cause, or the log lacks the ground truth.
    """
    number, root = (0, cause) if isinstance(cause, RootCause) else _chosen(run, found, cause)
    if not has_truth(run):
        raise PicktreeError(
            f"{run.path}: the log has no ground truth, so its items cannot be found again in the simulation; "
            "only a run of the simulation with its truth can be proved"
        )
    account = run.account
    failures = failures_of(run, account)
    case = investigation(run, account, failures, truth=True)
    own = [each for each in failures if each.number in root.failures]
    since = _since(case, root, own)
    if run.info.continues is not None and since + run.info.tick < run.info.continues.time - 1e-6:
        raise PicktreeError(
            f"{run.path}: the cause acts before the log begins, at {seconds(since)}; prove the run that it "
            f"continues: {run.info.continues.log or 'its log is not known'}"
        )
    removal = _removal(case, root)
    advice = "" if removal else next(text for begin, text in _ADVICE if root.cause.startswith(begin))
    facts = _facts(case, root, own, found)
    times = [*(each.time for each in own), *([] if root.time is None else [root.time])]
    last = max(times, default=case.end)
    return Experiment(number, root, removal, advice, since, last, tuple(facts), facts)


def _chosen(run: RunRecord, found: Explanation, cause: str) -> tuple[int, RootCause]:
    codes = [root.cause for root in found.root_causes]
    if not codes:
        raise PicktreeError(f"{run.path}: the run has no root cause, so nothing can be proved")
    if cause.isdecimal() and 1 <= int(cause) <= len(codes):
        return int(cause), found.root_causes[int(cause) - 1]
    if cause in codes:
        return codes.index(cause) + 1, found.root_causes[codes.index(cause)]
    known = ", ".join(f"{number} {code}" for number, code in enumerate(codes, 1))
    raise PicktreeError(f"--cause {cause}: the run has no such root cause; it has {known}")


def _since(case: Investigation, root: RootCause, own: list[FailureStory]) -> float:
    """Return a time before the first effect of the cause, simulated s.

    It is the start of the first failed node, or of the first node about the item.
    """
    times = [case.visit(each).start for each in own]
    if root.time is not None:
        times.append(root.time)
    if not times:
        names = {root.item, *root.items}
        times = [visit.start for visit in case.family.visits if visit.item in names]
    begins = case.run.ticks.times[0]
    return max(0.0, min(times, default=begins) - case.run.info.tick)


def _facts(
    case: Investigation, root: RootCause, own: list[FailureStory], found: Explanation
) -> dict[Fact, str]:
    """Return the outcomes of the cause, in words: its items, else the goal, else its costliest failure."""
    items = ((true_item(case, name), name) for name in root.items)
    if facts := {f"item {true}": f"{name} is not where it belongs" for true, name in items if true}:
        return facts
    if not own or root.ended_run:
        return {GOAL: "the goal is missed"}
    costly = max(own, key=lambda each: each.seconds_lost)
    fact = failure_fact(costly.cause, costly.id, costly.item)
    return {fact: f"{costly.name_and_item} fails with {costly.cause}"}


def true_item(case: Investigation, name: str) -> str | None:
    """Return the true item of a name in an explanation, believed or true; None: it is not known."""
    inner = re.search(r"\((item_\d+)\)$", name)
    for each in (case.pairs.get(name, ""), name, inner[1] if inner else ""):
        if each in case.bodies.tracks:
            return each
    return None


def _removal(case: Investigation, root: RootCause) -> Removal | None:
    cause, about = root.cause, root.about
    if cause in _PART_OF_ITEM:
        part, words = _PART_OF_ITEM[cause]
        true = true_item(case, about) or true_item(case, root.item)
        sentence, is_state = f"{root.item or true} {words}", cause not in _EVENTS
        return Removal(sentence, (f"{part} {true}",), is_state=is_state) if true else None
    if cause in _DEVICES:
        part, words = _DEVICES[cause]
        return Removal(words, (part,), is_state=part != "arrivals")
    if cause == "joint.weak":
        return Removal(f"{about} has all its torque", (f"joint {about}",))
    if cause.startswith("camera."):
        name = about.removeprefix("the camera ")
        return Removal(f"the camera {name} is nominal", (f"camera {name}".rstrip(),))
    if cause in _BODIES and (body := _true_body(case, root)):
        return Removal(f"{body} is not there", (f"body {body}",))
    if cause in _SKILLS:
        return Removal(f"nothing interferes with {about}", (f"skill {about}",), is_state=False)
    if cause == "run.limit":
        return Removal("the run has more time", longer=True)
    return _corrected_mission(case, root)


def _true_body(case: Investigation, root: RootCause) -> str:
    """Return the body that the robot did not know, by its name or at the believed place; empty: not found."""
    if root.about in case.obstacles.tracks:
        return root.about
    seen = case.belief.tracks.get(root.about)
    return "" if seen is None else case.obstacle_at(seen.last)


def _corrected_mission(case: Investigation, root: RootCause) -> Removal | None:
    """Return the correction of a port of the mission; None: no correction is known."""
    cause, node = root.cause, root.about
    ports = case.ports(node)
    if cause == "mission.no_look" and case.scene is not None and case.scene.cameras:
        camera = min(case.scene.cameras, key=lambda each: each.on != "world").name
        return Removal(f"the mission begins with a look of {camera}", look=camera)
    if cause in ("tree.timeout", "mission.time_is_up") and "msec" in ports:
        return Removal(f"{node} has no time limit", settings={f"/{node}.msec": "0"})
    if cause == "grasp.weak" and case.robot is not None:
        most = case.robot.gripper.max_force
        return Removal(f"the fingers press with {most:g} N", settings={f"/{node}.force": f"{most:g}"})
    if cause == "mission.wrong_bin":
        items = [true for name in root.items if (true := true_item(case, name)) is not None]
        belongs = {case.verdicts[true].destination for true in items if true in case.verdicts}
        if len(belongs) == 1 and (into := belongs.pop()):
            sentence = f"{node} places into {into}, where {listed(list(root.items), 3)} belongs"
            return Removal(sentence, settings={f"/{node}.into": into})
    return None
