"""The folder: its files, drafts, examples and trust, and the jobs that run in it."""

from __future__ import annotations

import asyncio
import shutil
import time
from pathlib import Path

import pytest

from picktree.apps.studio.folder_slice import EXAMPLES, example_files
from picktree.apps.studio.job_process import MAX_OUTPUT
from picktree.apps.studio.jobs import Job, Jobs, job_text
from picktree.apps.studio.workspace import Workspace
from picktree.files import PicktreeError
from picktree.logs import RunLog, RunResult
from picktree.trees.loading import PLUGINS_VARIABLE

from .conftest import PATIENCE, Refused, Served, on_a_loop, serving

MISSION = "picktree: 1\nkind: mission\nname: wave\nplugins: [wave.py]\ntrees:\n  Main: Wave\n"
PLUGIN = '''
from picktree.trees import Skill
open("ran", "w").close()


class Wave(Skill):
    """Wave the hand."""

    def run(self, world):
        yield


NODES = (Wave,)
'''


def test_a_file_is_written_whole_and_never_over_what_others_wrote(served: Served) -> None:
    with served.client() as client:
        first = client.call("files.write", path="new/a.yaml", text="one\n")
        with pytest.raises(Refused, match=r"new/a\.yaml exists"):
            client.call("files.write", path="new/a.yaml", text="two\n")
        (served.folder / "new" / "a.yaml").write_text("theirs\n")
        with pytest.raises(Refused, match="changed by another program"):
            client.call("files.write", path="new/a.yaml", text="two\n", version=first["version"])
        read = client.call("files.read", path="new/a.yaml")
        client.call("files.write", path="new/a.yaml", text="two\n", version=read["version"])
    assert (served.folder / "new" / "a.yaml").read_text() == "two\n"
    assert [each.name for each in (served.folder / "new").iterdir()] == ["a.yaml"]


def test_what_was_typed_is_there_after_the_server_died(tmp_path: Path, state_home: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "a.yaml").write_text("saved\n")
    with serving(folder) as first, first.client() as client:
        client.call("files.draft", path="a.yaml", text="typed\n")
    with serving(folder) as second, second.client() as client:
        assert second.workspace.state.token == first.workspace.state.token
        found = client.call("files.read", path="a.yaml")
        assert (found["text"], found["draft"]) == ("saved\n", "typed\n")
        client.call("files.write", path="a.yaml", text="typed\n", version=found["version"])
        assert client.call("files.read", path="a.yaml")["draft"] is None


def test_the_examples_are_offered_and_overwrite_nothing(served: Served) -> None:
    (served.folder / "one_pick.yaml").write_text("mine\n")
    with served.client() as client:
        written = client.call("folder.copy_examples")
        assert sorted(written) == sorted(
            str(each) for each in example_files() if each != Path("one_pick.yaml")
        )
        kinds = {each["kind"] for each in client.call("folder.state")["files"]}
    assert kinds == {"mission", "faults", "cases", "plan"}
    assert (served.folder / "one_pick.yaml").read_text() == "mine\n"


@pytest.fixture
def workspace(tmp_path: Path, state_home: Path, monkeypatch: pytest.MonkeyPatch) -> Workspace:
    """A workspace without a server."""
    monkeypatch.setenv(PLUGINS_VARIABLE, "")
    folder = tmp_path / "folder"
    folder.mkdir()
    return Workspace(folder)


def test_plugins_run_only_after_somebody_has_said_so(workspace: Workspace) -> None:
    (workspace.root / "wave.yaml").write_text(MISSION)
    (workspace.root / "wave.py").write_text(PLUGIN)
    (workspace.root / "yaml.py").write_text("open('stolen', 'w').close()\n")  # as a library's module

    async def check() -> Job:
        jobs = Jobs(workspace)
        workspace.apply_trust()
        return await jobs.ended(jobs.start("Check", ["check", str(workspace.root / "wave.yaml")]))

    refused = on_a_loop(check)
    assert (refused.outcome, "P262" in job_text(refused)) == ("failed", True), job_text(refused)
    assert not (workspace.root / "ran").exists()
    workspace.state.trust(True)
    checked = on_a_loop(check)
    assert (checked.outcome, (workspace.root / "ran").exists()) == ("done", True), job_text(checked)
    assert not (workspace.root / "stolen").exists()


def test_a_job_that_prints_for_ever_fills_no_disk(workspace: Workspace) -> None:
    loud = (
        "import sys, time\n"
        "for number in range(40):\n"
        "    print(f'line {number}\\n' * 100_000, flush=True)\n"
        "    time.sleep(0.02)\n"
        "time.sleep(1)\nprint('the end', flush=True)\n"
    )
    (workspace.root / "wave.py").write_text(loud + PLUGIN)
    (workspace.root / "wave.yaml").write_text(MISSION)
    workspace.state.trust(True)

    async def check() -> tuple[Job, str]:
        jobs = Jobs(workspace)
        workspace.apply_trust()
        job = await jobs.ended(jobs.start("Check", ["check", str(workspace.root / "wave.yaml")]))
        return job, await jobs.output(job.number)

    job, shown = on_a_loop(check)
    assert 1000 < job.output.stat().st_size <= MAX_OUTPUT
    assert shown.startswith("[the output was larger than 10 MB: its beginning is left out]\n[the end of ")
    assert "\nthe end\n" in shown


def test_a_job_is_stopped_with_what_it_has_started(workspace: Workspace) -> None:
    shutil.copy(EXAMPLES / "one_pick.yaml", workspace.root)

    async def stopped() -> Job:
        jobs = Jobs(workspace)
        words = ["run", "one_pick.yaml", "--backend", "kinematic", "--pace", "0.2"]
        job = jobs.start("Run", words, keeps_on=True)
        end = time.monotonic() + PATIENCE
        while "recording to" not in job_text(job) and time.monotonic() < end:
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.5)
        await jobs.close()  # it goes on when the server ends
        later = Jobs(workspace)
        (taken,) = await later.take_over()
        assert (taken.number, taken.ended) == (job.number, None)
        await later.stop(taken.number)
        return await later.ended(taken)

    job = on_a_loop(stopped)
    assert job.outcome == "stopped"
    (log,) = workspace.root.glob("runs/*/log.mcap")
    with RunLog(log) as read:
        assert "json" in read.result, job_text(job)
        assert RunResult.from_json_text(read.result["json"], log).status == "interrupted"


def test_too_many_jobs_are_refused(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("picktree.apps.studio.jobs.MAX_JOBS", 0)
    with pytest.raises(PicktreeError, match="0 jobs are running"):
        Jobs(workspace).start("Check", ["check", "a.yaml"])
    monkeypatch.undo()
    monkeypatch.setattr("picktree.apps.studio.jobs.MIN_FREE", 1 << 62)
    with pytest.raises(PicktreeError, match="the disk has"):
        Jobs(workspace).start("Check", ["check", "a.yaml"])
