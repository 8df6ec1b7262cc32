"""Names of path planners: the built-in ones, and those that installed plug-ins add."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated

from pydantic import AfterValidator, WithJsonSchema

from picktree.files import describe, suggest_name
from picktree.files.yaml import file_models

GROUP = "picktree.planners"
"""Entry point group of installed planners: name of the planner, and its function as `module:function`."""
AUTO = "auto"
"""Name of the planner that is used where none is chosen."""
BUILT_IN: Mapping[str, str] = {
    AUTO: "the straight motion in joint space, else picktree's own RRT-Connect; CBiRRT under constraints",
    "rrt_connect": "OMPL's RRTConnect: two trees, the first path that they find",
    "kpiece": "OMPL's KPIECE1: one tree, guided by the coverage of a projection",
    "bkpiece": "OMPL's BKPIECE1: KPIECE with two trees",
    "lbkpiece": "OMPL's LBKPIECE1: the same, edges checked late",
    "rrt_star": "OMPL's RRTstar: one tree, rewired towards the shortest path",
    "informed_rrt_star": "OMPL's InformedRRTstar: samples only where a shorter path may be",
    "bit_star": "OMPL's BITstar: batches of samples, the most promising edges first",
    "aorrtc": "OMPL's AORRTC: RRT-Connect, repeated under the cost of the best path",
    "prm_star": "OMPL's PRMstar: a roadmap, built for each request",
}
"""One line for each built-in planner, by name."""


@lru_cache(maxsize=2)
def _installed(_: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    """Return the entry points of planners in these folders."""
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda each: each.value)}


def installed_planners() -> Mapping[str, EntryPoint]:
    """Return the planners of installed plug-ins by name. A name of a built-in planner is not among them."""
    found = _installed(tuple(sys.path))
    return {name: entry for name, entry in found.items() if name not in BUILT_IN}


def planner_names() -> tuple[str, ...]:
    """Return the names of all planners, the built-in ones first."""
    return (*BUILT_IN, *installed_planners())


def is_planner(name: str) -> bool:
    return name in BUILT_IN or name in installed_planners()


def suggest_planner(name: str) -> str:
    """Return the hint for an unknown name: the nearest one, also for the spellings of OMPL and MoveIt.

    >>> suggest_planner("BIT*"), suggest_planner("geometric::BKPIECEkConfigDefault")
    ("did you mean 'bit_star'?", "did you mean 'bkpiece'?")
    """
    plain = _plain(name)
    for known in planner_names():
        if _plain(known) == plain:
            return f"did you mean {known!r}?"
    return suggest_name(name, planner_names())


def unknown_planner(name: str) -> str:
    """Return the sentence of an unknown name, without a hint."""
    return f"there is no planner {describe(name)}"


def _checked_name(name: str) -> str:
    if not is_planner(name):
        raise file_models.InvalidValue(unknown_planner(name), suggest_planner(name), code="P108")
    return name


PlannerName = Annotated[
    str,
    AfterValidator(_checked_name),
    WithJsonSchema({"anyOf": [{"enum": list(BUILT_IN)}, {"type": "string"}]}),
]
"""Name of a planner in a file. Installed plug-ins may add to the proposed ones."""


def _plain(name: str) -> str:
    """Return a name without the differences between spellings: `RRT*`, `RRTstar` and `rrt_star` are the
    same."""
    word = name[:60].lower().replace("*", "star").removeprefix("geometric::").removesuffix("kconfigdefault")
    return re.sub(r"[^a-z0-9]", "", word).removesuffix("1")
