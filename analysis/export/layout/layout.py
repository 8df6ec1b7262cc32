"""A layout made for one log, as the file that Lichtblick and Foxglove import."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ...run import Run
from . import panels
from .layout_format import LayoutFile, Panel, Split, TabEntry
from .view_3d import three_dee


@dataclass(frozen=True, slots=True)
class Layout:
    file: LayoutFile

    @property
    def lanes(self) -> int:
        """How many lanes of statuses and events there are."""
        return sum(len(paths_of(panel)) for key, panel in self.panels if key.startswith("StateTransitions!"))

    @property
    def panels(self) -> tuple[tuple[str, Panel], ...]:
        """With their ids, `TYPE!NAME`; without those that merely hold others as tabs."""
        return tuple((key, p) for key, p in self.file["configById"].items() if not key.startswith("Tab!"))

    def to_json_text(self) -> str:
        """With a line's end."""
        return json.dumps(self.file, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


class _Desk:
    """Collects panels under the ids by which the arrangement names them."""

    def __init__(self) -> None:
        self.panels: dict[str, Panel] = {}

    def put(self, kind: str, panel: Panel) -> str:
        number = sum(1 for key in self.panels if key.startswith(f"{kind}!"))
        key = f"{kind}!picktree{number}"
        self.panels[key] = panel
        return key

    def tabs(self, entries: Sequence[tuple[str, str]]) -> str:
        """One panel as itself, more of them behind tabs; a pair is the tab's title and the panel."""
        if len(entries) == 1:
            return entries[0][1]
        tabs: list[TabEntry] = [{"title": title, "layout": panel} for title, panel in entries]
        return self.put("Tab", {"activeTabIdx": 0, "tabs": tabs})


def layout(run: Run) -> Layout:
    """For the run's own tree, topics, joints and cameras. Raises PicktreeError where the log is damaged."""
    desk = _Desk()
    view = desk.tabs(
        [
            ("Belief", desk.put("3D", three_dee(run.log, "Belief", truth=False))),
            ("Belief and truth", desk.put("3D", three_dee(run.log, "Truth in magenta", truth=True))),
        ]
    )
    raw = [(p["foxglovePanelTitle"], desk.put("RawMessages", p)) for p in panels.raw_messages(run)]
    texts = desk.tabs([("Running nodes", desk.put("RawMessages", panels.running_nodes())), *raw])
    pictures = [(p["foxglovePanelTitle"], desk.put("Image", p)) for p in panels.images(run)]
    right = _column([texts, *([desk.tabs(pictures)] if pictures else [])], 50.0)
    tree = desk.put("StateTransitions", panels.state_transitions(run))
    drawn = [(p["foxglovePanelTitle"], desk.put("Plot", p)) for p in panels.plots(run)]
    lines = desk.put("RosOut", panels.log())
    below = _column([*([desk.tabs(drawn)] if drawn else []), lines], 60.0)
    return Layout(
        {
            "configById": desk.panels,
            "globalVariables": {},
            "userNodes": {},
            "playbackConfig": {"speed": 1.0},
            "layout": _split(
                "column", _split("row", view, right, 62.0), _split("row", tree, below, 50.0), 55.0
            ),
        }
    )


def _column(panes: Sequence[str], percentage: float) -> str | Split:
    """The panes below each other, the first with that share of the height."""
    first, *others = panes
    return functools.reduce(lambda above, pane: _split("column", above, pane, percentage), others, first)


def _split(
    direction: Literal["row", "column"], first: str | Split, second: str | Split, percentage: float
) -> Split:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percentage}


def paths_of(panel: Panel) -> tuple[str, ...]:
    """The message paths that a panel shows; whole topics are none."""
    if "paths" in panel:
        return tuple(path["value"] for path in panel["paths"])
    return (panel["topicPath"],) if "topicPath" in panel else ()
