"""Runs over the socket: listed as they come, opened, explained, continued; and none from outside."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from picktree.apps.studio.run_slice import Query, RunTable
from picktree.apps.studio.workspace import Workspace
from picktree.logs import RunResult
from picktree.logs.log_files import Rotation
from picktree.session import RunRequest, Session

from .conftest import Refused, Served


@pytest.fixture
def run(served: Served, picked: RunResult) -> str:
    """A run in the folder; its identity."""
    shutil.copytree(picked.folder, served.folder / "runs" / "first")
    return "runs/first"


def test_runs_appear_as_they_come(served: Served, picked: RunResult) -> None:
    with served.client() as client:
        events = client.watch("runs.index")
        assert next(events)["total"] == 0
        shutil.copytree(picked.folder, served.folder / "runs" / "first")
        event = next(each for each in events if each["total"])
        (row,) = event["rows"]
        assert (row["id"], row["mission"], row["status"], row["sorted"]) == (
            "runs/first",
            "one pick",
            "success",
            1,
        )


def test_links_and_pipes_are_no_runs(served: Served, run: str, picked: RunResult) -> None:
    (served.folder / "runs" / "linked").mkdir()
    (served.folder / "runs" / "linked" / "log.mcap").symlink_to(picked.log)
    os.mkfifo(served.folder / "runs" / "pipe.mcap")
    with served.client() as client:
        assert [row["id"] for row in next(client.watch("runs.index"))["rows"]] == [run]
        with pytest.raises(Refused, match="is not below the folder"):
            client.call("runs.open", id="runs/linked")
        with pytest.raises(Refused, match="is not a file of a log"):
            client.call("runs.open", id="runs/pipe.mcap")


def test_a_link_named_runs_is_not_followed(served: Served, picked: RunResult) -> None:
    (served.folder / "runs").symlink_to(picked.folder.parent, target_is_directory=True)
    with served.client() as client:
        event = next(each for each in client.watch("runs.index"))
        assert (event["total"], "is not below the folder" in event["problem"]) == (0, True)


def test_a_run_is_opened_and_explained_as_the_command_does(served: Served, run: str) -> None:
    with served.client() as client:
        opened = client.call("runs.open", id=run)
        assert (opened["id"], opened["mission"], opened["log"]) == (run, "one pick", "runs/first/log.mcap")
        assert "one pick" in opened["mission_text"]
        explained = client.call("runs.explain", id=run)
        assert explained["outcome"]["status"] == "success"
        with pytest.raises(Refused, match="there is no such log"):
            client.call("runs.explain", id="runs/none")


def test_a_film_begins_where_its_log_begins(served: Served) -> None:
    mission = Path(__file__).parents[2] / "examples" / "sort_by_colour.yaml"
    runs, parts = served.folder / "runs", Rotation(seconds=1.0)
    request = RunRequest(mission, backend="kinematic", out=runs, limit=1.5, rotation=parts)
    name = Session(request).run().folder.name
    with served.client() as client:
        number = client.call("runs.write_film", id=f"runs/{name}/log-0002.mcap", end=1.2)
        jobs = next(j for j in client.watch("jobs.watch") if j[0]["outcome"] != "running")
        assert jobs[0]["outcome"] == "done", client.call("jobs.output", number=number)
        status, _, film = served.get(jobs[0]["result"])
    assert (status, film[4:8]) == (200, b"ftyp")


def table(tmp_path: Path, picked: RunResult) -> RunTable:
    for number in range(3):
        shutil.copytree(picked.folder, tmp_path / "runs" / f"{number}")
    (tmp_path / "runs" / "2" / "log.mcap").write_bytes(b"no log")
    made = RunTable(Workspace(tmp_path))
    made.look()
    return made


def test_a_query_filters_and_sorts_with_missing_values_last(
    tmp_path: Path, state_home: Path, picked: RunResult
) -> None:
    made = table(tmp_path, picked)

    def folders(query: Query) -> list[str]:
        return [row.folder for row in made.select(query)]

    assert folders(Query(sort="folder", descending=False)) == ["0", "1", "2"]
    for descending in (True, False):
        assert folders(Query(sort="seconds", descending=descending))[-1] == "2"
    assert folders(Query(text="ONE pick", sort="folder")) == ["1", "0"]
    assert folders(Query(where="status == 'unreadable'")) == ["2"]
    assert folders(Query(where="sorted > 0", text="unreadable")) == []
    shutil.rmtree(tmp_path / "runs" / "1")
    made.look()
    assert folders(Query(text="ONE pick", sort="folder")) == ["0"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"where": "statu == 'x'"}, "did you mean 'status'"),
        ({"sort": "size"}, "there is no column 'size'; sort by written"),
    ],
)
def test_a_condition_that_is_wrong_is_told(
    served: Served, run: str, arguments: dict[str, str], said: str
) -> None:
    with served.client() as client, pytest.raises(Refused, match=said):
        next(client.watch("runs.index", **arguments))
