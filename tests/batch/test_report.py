"""The page of a batch: what stands in it, and that it shows it without a network."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from picktree.apps.batch import Batch, BatchPlan, Executor, write_report

from .watching import Remembering

ONE_PICK = Path(__file__).parents[2] / "examples/one_pick.yaml"


def data_of(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def test_a_page_holds_what_the_results_say_and_links_to_the_worst_runs(
    tmp_path: Path, worker: Executor
) -> None:
    missed = tmp_path / "missed.yaml"  # the goal is one that no run can reach
    missed.write_text(re.sub(r"^goal:.*\n", "", ONE_PICK.read_text(), flags=re.M) + "goal: sorted > total\n")
    plan = BatchPlan("two", (ONE_PICK, missed), (0, 1), backend="kinematic")
    folder = tmp_path / "batch"
    with Batch.create(folder, plan) as batch:
        assert batch.run(worker, Remembering())
    write_report(folder, tmp_path / "page.html", runs=1)
    page = (tmp_path / "page.html").read_text()
    data = data_of(page)
    assert [(r["label"], r["success"]["successes"]) for r in data["recipes"]] == [
        ("one_pick", 2),
        ("missed", 0),
    ]
    assert len(data["rates"]) == 4
    assert sum(place["rate"]["total"] for place in data["places"]) == 4 * 4
    assert [(job["seed"], job["label"], job["status"]) for job in data["jobs"]] == [
        (0, "one_pick", "success"),
        (1, "one_pick", "success"),
        (0, "missed", "incomplete"),
        (1, "missed", "incomplete"),
    ]
    assert [(w["seed"], w["label"]) for w in data["worst"]] == [(0, "missed"), (1, "missed")]
    assert (tmp_path / data["worst"][0]["report"]).is_file()
    assert data["worst"][1]["report"] == ""  # a page of one run was asked for
    assert not re.search(r"""(?:src|href)=["']https?:""", page)
    assert list(tmp_path.glob(".*")) == []


def test_names_cannot_break_out_of_the_page(tmp_path: Path) -> None:
    plan = BatchPlan("</title><script>", (ONE_PICK,), (0,), backend="kinematic")
    with Batch.create(tmp_path / "batch", replace(plan, settings={"Grasp.force": ("15",)})):
        write_report(tmp_path / "batch", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "<title>Batch &lt;/title>&lt;script></title>" in page
