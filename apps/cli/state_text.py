"""Text of a tree, a node, the blackboard and the belief, of a running mission or of a log."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from picktree.files import Expression
from picktree.trees import show
from picktree.world import Pose

if TYPE_CHECKING:
    from rich.text import Text

STYLED_STATUS_MARKS = {
    "IDLE": ("·", "dim"),
    "RUNNING": ("▶", "bold cyan"),
    "SUCCESS": ("✓", "green"),
    "FAILURE": ("✗", "red"),
    "SKIPPED": ("–", "dim"),
}


@dataclass(frozen=True, slots=True)
class NodeRow:
    """Node of a tree with its status and message."""

    path: str
    name: str
    id: str
    """Registered name, such as `Grasp`."""
    status: str
    message: str = ""
    """Cause and message of a failure, or the feedback message; empty without one."""


def tree_rows(nodes: Sequence[NodeRow], room: int, also: Collection[str] = ()) -> list[Text]:
    """Return a row for each node that runs or has a running parent, and for the paths `also`.

    At most `room` rows are kept: those nearest to the last failed node of `also`, and its ancestors. Without
    such a node they are the running ones, and those nearest to the last of them.
    """
    running = {node.path for node in nodes if node.status == "RUNNING"}
    shown = [node for node in nodes if node.path in also or {node.path, _above(node.path)} & {*running, ""}]
    active = [index for index, node in enumerate(shown) if node.path in running]
    failed = [i for i, node in enumerate(shown) if node.path in also and node.status == "FAILURE"]
    centre = max(failed, key=lambda i: shown[i].path.count("/"), default=active[-1] if active else 0)
    leaf = shown[centre].path if failed else ""
    first = {i for i, node in enumerate(shown) if leaf == node.path or leaf.startswith(f"{node.path}/")}
    by_worth = sorted(range(len(shown)), key=lambda i: (i not in (first or active), abs(i - centre)))
    return [_row(shown[index]) for index in sorted(by_worth[:room])]


def _above(path: str) -> str:
    return path.rpartition("/")[0]


def _row(node: NodeRow) -> Text:
    from rich.text import Text

    mark, style = STYLED_STATUS_MARKS[node.status]
    row = Text("  " * node.path.count("/"), no_wrap=True)
    row.append(f"{mark} {node.id}" + (f" {node.name}" if node.name != node.id else ""), style=style)
    if node.message:
        row.append(f"  {node.message}", style="dim" if node.status != "FAILURE" else "red")
    return row


def status_text(cause: object, message: str) -> str:
    """Return the text of a node's status: cause and message, or the message alone."""
    return f"{cause}: {message}" if cause else message


def tree_lines(nodes: Iterable[NodeRow], top: str = "", marked: str = "") -> Iterator[str]:
    """Yield a line for each node, or for `top` and its descendants. The node `marked` has an arrow."""
    indent = top.count("/")
    for node in nodes:
        if not top or node.path == top or node.path.startswith(f"{top}/"):
            name = node.name if node.name.split("#")[0] == node.id else f"{node.id} {node.name}"
            margin = ("→ " if node.path == marked else "  ") + "  " * (node.path.count("/") - indent)
            message = f"  {node.message}" if node.message else ""
            yield f"{margin}{STYLED_STATUS_MARKS[node.status][0]} {name}{message}"


def where_lines(nodes: Iterable[NodeRow], end: str) -> Iterator[str]:
    for node in nodes:
        if node.path == end or end.startswith(f"{node.path}/"):
            message = f": {node.message}" if node.message else ""
            yield f"{STYLED_STATUS_MARKS[node.status][0]} {node.path} is {node.status}{message}"


def failure_lines(origin: str, cause: object, message: str, evidence: Mapping[str, object]) -> Iterator[str]:
    yield f"  failed in {origin}: {cause}: {message}"
    for name, value in evidence.items():
        yield f"    {name}: {value_text(value)}"


def blackboard_lines(board: Mapping[str, object], part: str) -> Iterator[str]:
    """Yield the keys that contain `part`, with their values; a single one in full."""
    keys = sorted(key for key in board if part in key)
    if not keys:
        yield f"no key contains {part!r}" if part else "nothing is written yet"
    for key in keys:
        yield f"{key} = {board[key]!r}" if len(keys) == 1 else f"{key} = {value_text(board[key])}"


def value_text(value: object) -> str:
    """Return a value of a port or the blackboard in one line."""
    return str(value) if isinstance(value, Expression) else show(value)


class BelievedLike(Protocol):
    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def colour(self) -> str: ...
    @property
    def role(self) -> str: ...
    @property
    def place(self) -> str: ...
    @property
    def attached(self) -> bool: ...
    @property
    def pose(self) -> Pose: ...
    @property
    def last_seen(self) -> float: ...
    @property
    def confidence(self) -> float: ...


def belief_lines(bodies: Iterable[BelievedLike], part: str, now: float) -> Iterator[str]:
    """Yield the believed objects whose id contains `part`; `now`: simulated time, s."""
    found = [body for body in bodies if part in body.id]
    if not found:
        yield f"no object is called {part!r}" if part else "no object is known yet"
    for body in found:
        yield _belief_line(body, now)


def _belief_line(o: BelievedLike, now: float) -> str:
    x, y, z = o.pose.position
    place = "in the hand" if o.attached else o.place or "somewhere"
    mass = getattr(o, "mass", None)
    weighed = "" if mass is None else f", weighed {mass * 1000:.0f} g"
    seen = f"seen {now - o.last_seen:.1f} s ago, confidence {o.confidence:.2f}"
    return (
        f"{o.id}: {o.colour} {o.kind}, {o.role}, {place}, at ({x:.3f}, {y:.3f}, {z:.3f}) m{weighed}, {seen}"
    )
