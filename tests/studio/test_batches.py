"""Batches over the socket: a plan, its matrix and cost; a batch that is started, stopped and resumed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.batch import forecast, load_plan, recorded_batches
from picktree.apps.studio.batch_slice import BatchFolder, form_of, with_key

from .conftest import Refused, Served

EXAMPLES = Path(__file__).parents[2] / "examples"
JOBS = 7
"""Jobs of a batch that is stopped: so many that some are left when the word comes, on a busy machine, too."""
PLAN = """picktree: 1
kind: plan
# Which missions.
missions: [one_pick.yaml]  # one
seeds: 0:8

# How.
backend: kinematic
keep: all
"""


@pytest.fixture
def plan(served: Served) -> str:
    """A plan of eight kinematic jobs, and its mission."""
    shutil.copy(EXAMPLES / "one_pick.yaml", served.folder)
    (served.folder / "night.yaml").write_text(PLAN, encoding="utf-8")
    return "night.yaml"


@pytest.mark.parametrize(
    ("key", "value", "changed"),
    [
        ("seeds", "0:4", PLAN.replace("0:8", "0:4")),
        ("seeds", None, PLAN.replace("seeds: 0:8\n", "")),
        ("name", "a b", PLAN.replace("kind: plan\n", "kind: plan\nname: a b\n")),
        ("scenes", ["dense"], PLAN.replace("one\n", "one\nscenes: [dense]\n")),
        ("set", {"A.b": [1, "x: y"]}, PLAN.replace("0:8\n", '0:8\nset: {A.b: [1, "x: y"]}\n')),
        ("keep", "none", PLAN.replace("keep: all", "keep: none")),
    ],
)
def test_a_form_changes_the_lines_of_its_key_only(key: str, value: Any, changed: str) -> None:
    text = with_key(PLAN, key, value)
    assert text == changed
    assert form_of(text).get(key) == value


def test_a_plan_is_checked_as_it_is_typed(served: Served, plan: str) -> None:
    with served.client() as client:
        found = client.call("plans.check", path=plan, text=PLAN.replace("0:8", "0:4"))
        assert (found["faults"], found["forecast"]["jobs"]) == ([], 4)
        wrong = client.call("plans.check", path=plan, text=PLAN.replace("one_pick", "two_picks"))
        (fault,) = wrong["faults"]
        assert "two_picks.yaml" in fault["file"] + fault["message"]
        with pytest.raises(Refused, match="is not below the folder"):
            client.call("plans.check", path="../night.yaml", text=PLAN)
        with pytest.raises(Refused, match="a plan has no key"):
            client.call("plans.change", text=PLAN, key="picktree", value=2)


def until(progress: Iterator[Any], done: int, *, running: bool | None = None) -> Any:
    """Return the first progress with at least so many jobs done, of a batch that is running or not."""
    return next(p for p in progress if p["done"] >= done and running in (None, p["running"]))


def test_a_batch_is_started_stopped_and_resumed_and_tells_what_came_of_it(served: Served, plan: str) -> None:
    with served.client() as client, served.client() as watching:
        (served.folder / plan).write_text(PLAN.replace("0:8", f"0:{JOBS}"), encoding="utf-8")
        batch = client.call("plans.start", path=plan, workers=1)["id"]
        seen = watching.watch("batches.progress", id=batch)
        until(seen, 1)
        assert BatchFolder(served.folder / batch).runner() is not None
        with pytest.raises(Refused, match="another process runs this batch"):
            client.call("batches.resume", id=batch)
        client.call("batches.stop", id=batch)
        stopped = until(seen, 1, running=False)
        assert 1 <= stopped["done"] < stopped["total"] == JOBS
        with pytest.raises(Refused, match="no process runs this batch"):
            client.call("batches.stop", id=batch)
        client.call("batches.resume", id=batch, workers=2)
        ended = until(seen, JOBS, running=False)
        assert ended["counts"] == {"success": JOBS}
        (row,) = next(client.watch("batches.index"))
        assert (row["id"], row["done"], "jobs" in row) == (batch, JOBS, False)

        summary = client.call("batches.summary", id=batch)
        assert summary["recipes"][0]["success"]["successes"] == JOBS
        jobs = client.call("batches.behind", id=batch, what="status", value="success")
        assert [each["seed"] for each in jobs] == list(range(JOBS))
        assert client.call("runs.open", id=jobs[2]["run"])["seed"] == 2
        assert client.call("batches.behind", id=batch, what="cause", value="' OR 1") == []
        with pytest.raises(Refused, match="is not a place on the table"):
            client.call("batches.behind", id=batch, what="place", value="here")
        with pytest.raises(Refused, match="is not the id of a job"):
            client.call("batches.rerun", id=batch, job="--out=x")
    # The jobs of this batch now tell what the next one costs.
    again = forecast(load_plan(served.folder / plan), recorded_batches(served.folder / "runs"), 2)
    (variant,) = again.variants
    spent = BatchFolder(served.folder / batch).progress()["cpu_seconds_a_job"]
    assert isinstance(spent, float)
    assert (variant.recorded, variant.jobs) == (JOBS, JOBS)
    assert variant.cpu_seconds == pytest.approx(JOBS * spent)
    assert again.wall_seconds == pytest.approx(JOBS / 2 * spent)
    assert again.to_text().splitlines()[-1].startswith(f"{JOBS} jobs on 2 workers: about ")


def test_a_lock_file_alone_is_no_running_batch(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text("{}")
    (tmp_path / "lock").write_text("1\n")
    assert BatchFolder(tmp_path).runner() is None


def test_two_batches_of_different_folders_are_compared(served: Served, plan: str) -> None:
    with served.client() as client:
        ids = list[str]()
        for name, seeds in ((plan, "0:3"), ("other.yaml", "1:4")):
            (served.folder / name).write_text(PLAN.replace("0:8", seeds), encoding="utf-8")
            ids.append(client.call("plans.start", path=name, workers=1)["id"])
            until(client.watch("batches.progress", id=ids[-1]), 3, running=False)
        moved = f"kept/last week/{Path(ids[1]).name}"
        (served.folder / moved).parent.mkdir(parents=True)
        (served.folder / ids[1]).rename(served.folder / moved)
        assert client.call("batches.summary", id=moved)["recipes"][0]["success"]["successes"] == 3

        number = client.call("batches.compare", id=ids[0], other=moved)
        jobs = next(j for j in client.watch("jobs.watch") if j[0]["outcome"] != "running")
        said = client.call("jobs.output", number=number)
        assert jobs[0]["outcome"] == "done", said
        assert "2 seeds" in said, said
        with pytest.raises(Refused, match="is not below the folder"):
            client.call("batches.compare", id=ids[0], other="../kept")
