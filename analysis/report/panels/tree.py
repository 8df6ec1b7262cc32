"""What the drawn tree shows: its picture, and the status of each node at each tick."""

from __future__ import annotations

from typing import cast

from ....authoring.drawing.formats.html import chart_json
from ...run import Run
from ..page_data.packing import Packable, Section
from ..page_data.tick_table import STATUSES, tick_table
from .tree_chart import charts_of


def pack_tree(run: Run) -> Section:
    table = tick_table(run)
    if not table.nodes:
        return Section("tree", {"empty": "The log holds no tree."})
    charts = charts_of(run)
    return Section(
        "tree",
        {
            "charts": [
                {"since": at.time, "chart": cast(Packable, chart_json(chart))}
                for at, chart in zip(run.trees, charts, strict=True)
            ],
            "paths": [node.path for node in table.nodes],
            "words": list(STATUSES),
            "statuses": table.statuses,
        },
    )
