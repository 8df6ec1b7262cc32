"""A server that is killed, and a browser that is closed: runs, texts and jobs are found again."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from picktree.files.file_system import ROOT

from ..browser import Chromium, wait_until
from ..needs import CHROMIUM, needs
from .conftest import PATIENCE, Client
from .server_process import studio_process
from .test_live import MISSION, end_runs
from .test_page import go

NAME = "sort_by_colour.yaml"
ONE = "one_pick.yaml"
PLAN = "picktree: 1\nkind: plan\nmissions: [one_pick.yaml]\nseeds: 0:4\nbackend: kinematic\n"


def cell_of(tmp_path: Path, *examples: str) -> Path:
    folder = tmp_path / "cell"
    folder.mkdir()
    for name in examples:
        shutil.copyfile(ROOT / "examples" / name, folder / name)
    return folder


def wait_for(holds: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


def first_line(text: str) -> str:
    return f"document.querySelector('.cm-line')?.textContent === '{text}'"


@needs(CHROMIUM)
def test_a_run_ends_well_and_the_text_is_there_again(
    tmp_path: Path, state_home: Path, chromium: Chromium
) -> None:
    folder = cell_of(tmp_path, NAME)
    (folder / "asking.yaml").write_text(MISSION, encoding="utf-8")
    order = {"mission": "asking.yaml", "backend": "kinematic", "parameters": {"rounds": "2"}}
    with studio_process(folder) as studio, chromium.blank(studio.address) as (browser, told):
        browser.set_default_timeout(PATIENCE * 1000)
        browser.goto(studio.served.link)
        go(browser, f"#/write/{NAME}")
        browser.locator(".cm-line").first.click()
        with studio.served.client() as client:
            identity = client.call("live.start", order=order)
        browser.keyboard.press("Control+Home")
        browser.keyboard.type("# typed before")
        studio.kill()  # before the page has sent it
        browser.get_by_text("The studio does not answer").wait_for()
        browser.keyboard.type(" and after\n")
        browser.wait_for_timeout(1000)
        assert not (folder / identity / "result.json").exists()  # the run goes on

        with studio_process(folder, studio.served.port) as again:
            browser.get_by_text("The studio does not answer").wait_for(state="detached")
            assert browser.evaluate(first_line("# typed before and after"))
            with again.served.client() as client:
                wait_for(lambda: client.call("files.drafted", path=NAME))
                assert client.call("files.drafted", path=NAME).startswith("# typed before and after\n")
            assert not [each for each in told.problems if "WebSocket" not in each]

            # The browser is closed and another one opened: text and run are there.
            browser.close()
            with chromium.blank(again.address) as (other, _):
                other.set_default_timeout(PATIENCE * 1000)
                other.goto(again.served.link)
                go(other, f"#/write/{NAME}")
                wait_until(other, first_line("# typed before and after"), PATIENCE)
                other.get_by_role("link", name="Run", exact=True).click()
                other.get_by_role("link", name=identity).click()
                other.get_by_role("heading", name="Help is wanted").wait_for()
                other.get_by_role("button", name="yes", exact=True).click()
                other.get_by_text("The run has ended: success.").wait_for()
            end_runs(folder)
    assert json.loads((folder / identity / "result.json").read_text())["status"] == "success"


def jobs_of(client: Client) -> list[Any]:
    return next(client.watch("jobs.watch"))


@needs(CHROMIUM)
def test_jobs_of_a_killed_server_are_listed_and_their_ends_are_seen(
    tmp_path: Path, state_home: Path, chromium: Chromium, troubled_log: Path
) -> None:
    folder = cell_of(tmp_path, ONE, NAME)
    (folder / "night.yaml").write_text(PLAN, encoding="utf-8")
    shutil.copytree(troubled_log.parent, folder / "runs" / "troubled")
    with studio_process(folder) as studio, chromium.blank(studio.address) as (browser, _):
        browser.set_default_timeout(PATIENCE * 1000)
        browser.goto(studio.served.link)
        with studio.served.client() as client:
            number = client.call("runs.whatif", id="runs/troubled", at=0.0, no_faults=True)
            batch = client.call("plans.start", path="night.yaml", workers=1)
            running = {job["number"]: job["outcome"] for job in jobs_of(client)}
        assert running == {number: "running", batch["job"]: "running"}
        go(browser, f"#/batch/{batch['id']}")
        browser.get_by_role("button", name="Jobs: 2 running").wait_for()
        studio.kill()
        code = next(state_home.rglob("state.json")).parent / "jobs" / f"{number}.code"
        wait_for(code.is_file)  # the what-if ends while there is no server

        with studio_process(folder, studio.served.port) as again:
            browser.get_by_role("button", name=re.compile("Jobs: [01] running")).wait_for()
            with again.served.client() as client:
                jobs = {job["number"]: job for job in jobs_of(client)}
                assert (jobs[number]["outcome"], jobs[number]["title"]) in (
                    ("done", "What-if from 0.00 s"),
                    ("no", "What-if from 0.00 s"),
                )
                # Its result was found, too: the run that it has made.
                made = client.call("runs.open", id=jobs[number]["result"].removeprefix("#/run/"))
                assert made["mission"] == "sort by colour"
                assert "what if" in client.call("jobs.output", number=number)
            browser.locator(".batch-head .outcome.done").wait_for()
            browser.get_by_role("button", name="Jobs: 0 running").click()
            entry = browser.locator(".job", has_text="Batch batch-night")
            assert entry.locator(".outcome").inner_text() == "done"


def test_a_killed_server_leaves_no_process_behind(tmp_path: Path, state_home: Path) -> None:
    folder = cell_of(tmp_path, NAME)
    with studio_process(folder) as studio:
        with studio.served.client() as client:
            client.call("scene.show", mission=NAME, scene="three_bins", seed=0, text=None)
        workers = children(studio.process.pid)
        assert workers
        studio.kill()
        wait_for(lambda: not any(map(alive, workers)))


def children(process: int) -> list[int]:
    """Return the processes below a process."""
    found: list[int] = []
    for entry in os.listdir("/proc"):
        with suppress(OSError, ValueError):
            words = Path(f"/proc/{int(entry)}/stat").read_text().rpartition(")")[2].split()
            if int(words[1]) == process and words[0] != "Z":
                found += [int(entry), *children(int(entry))]
    return found


def alive(process: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False
