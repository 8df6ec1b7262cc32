"""The pictures of docs/studio.md: `python -m tests.studio.studio_pictures FOLDER`, or `make pictures`.

Runs missions without physics, with and without planted faults, and photographs the studio of their folder in
headless Chromium. With `--all` each page is photographed in all sizes, light and dark, for
docs/studio-pictures.md.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from picktree.session import RunRequest, Session

from ..browser import Chromium
from .conftest import Client, Served, serving

EXAMPLES = Path(__file__).parents[2] / "examples"
FAULTS = ("slip.yaml", "remove.yaml", "gripper_weak.yaml")
QUALITY = 62
"""Quality of compressed pictures, %."""
SIZES = ((1280, 800), (1920, 1080), (390, 844))


@dataclass(frozen=True, slots=True)
class Shot:
    name: str
    address: str
    size: tuple[int, int]
    dark: bool = False
    compressed: bool = False


def make_folder(folder: Path) -> str:
    """Make a folder with examples and runs; return the identity of the run whose page is shown."""
    for name in ("sort_by_colour.yaml", "one_pick.yaml"):
        shutil.copy(EXAMPLES / name, folder)
    shutil.copytree(EXAMPLES / "faults", folder / "faults")

    def run(mission: str, seed: int, faults: str = "") -> Path:
        planted = folder / "faults" / faults if faults else None
        scene = "sort_small" if mission == "sort_by_colour.yaml" else None
        request = RunRequest(
            folder / mission, scene=scene, seed=seed, faults=planted, backend="kinematic", out=folder / "runs"
        )
        return Session(request).run().folder

    run("one_pick.yaml", 1)
    for seed, faults in enumerate(FAULTS):
        run("sort_by_colour.yaml", seed, faults)
    shown = run("sort_by_colour.yaml", 4, "remove.yaml")
    return shown.relative_to(folder).as_posix()


def stopped_run(client: Client) -> str:
    """Start a run and let it stop at its third item; return its identity."""
    order = {"mission": "sort_by_colour.yaml", "scene": "sort_small", "backend": "kinematic", "pace": 4.0}
    identity: str = client.call("live.start", order={**order, "seed": 4})
    client.call("live.command", id=identity, line="break Place after")
    stops = 0
    for event in client.watch("live.follow", id=identity):
        if event.get("stop"):
            stops += 1
            if stops == 2:
                break
            client.call("live.command", id=identity, line="continue")
    return identity


PLAN = """picktree: 1
kind: plan
missions: [one_pick.yaml]
seeds: 0:6
faults: [none, faults/slip.yaml]
backend: kinematic
"""


def run_batch(client: Client) -> str:
    """Run a batch to its end; return its identity."""
    client.call("files.write", path="night.yaml", text=PLAN, version=None)
    identity: str = client.call("plans.start", path="night.yaml")["id"]
    for event in client.watch("batches.progress", id=identity):
        if event["done"] == event["total"] and not event["running"]:
            break
    return identity


def shots(run: str, live: str, batch: str, *, every: bool) -> list[Shot]:
    pages = {
        "start": "#/",
        "runs": "#/runs",
        "run": f"#/run/{run}?t=6",
        "live": f"#/live/{live}",
        "write": "#/write/sort_by_colour.yaml",
        "batch": f"#/batch/{batch}",
    }
    if not every:
        return [
            Shot("studio-runs", pages["runs"], (1280, 560)),
            Shot("studio-run", pages["run"], (1280, 800)),
            Shot("studio-phone", pages["run"], (390, 844), dark=True),
            Shot("studio-live", pages["live"], (1280, 800)),
            Shot("studio-write", pages["write"], (1280, 800)),
        ]
    return [
        Shot(f"studio-{name}-{size[0]}-{'dark' if dark else 'light'}", address, size, dark, True)
        for name, address in pages.items()
        for size in SIZES
        for dark in (False, True)
    ]


def photograph(chromium: Chromium, served: Served, shot: Shot, out: Path) -> None:
    import cv2  # Not at the top: picktree comes before numpy.
    import numpy as np

    own = f"http://127.0.0.1:{served.port}/"
    with chromium.blank(own, shot.size, dark=shot.dark) as (page, _):
        page.goto(served.link)
        page.evaluate("(address) => { location.hash = address; }", shot.address)
        wait_for_content(page, shot)
        page.wait_for_timeout(500)
        if shot.compressed:
            picture = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
            assert picture is not None
            cv2.imwrite(str(out / f"{shot.name}.webp"), picture, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
        else:
            page.screenshot(path=str(out / f"{shot.name}.png"))


def wait_for_content(page: Any, shot: Shot) -> None:
    if shot.address.startswith("#/run/"):
        page.locator(".explanation").wait_for()
        page.frame_locator("iframe").locator("html[data-ready=yes]").wait_for(state="attached")
        page.wait_for_timeout(2500)
    elif shot.address.startswith("#/live/"):
        page.get_by_text("Stopped at").wait_for()
        page.locator(".live-view canvas").wait_for()
        page.wait_for_timeout(3000)
    elif shot.address.startswith("#/write/"):
        page.get_by_text("No faults").wait_for()
        line = page.locator(".cm-line", has_text="Recover:").first
        line.get_by_text("Recover", exact=True).click()  # the line is wider than the view of a phone
        page.mouse.move(1, 1)  # off the word, whose documentation would cover the page
        page.wait_for_timeout(1500)
    elif shot.address.startswith("#/batch/"):
        page.locator(".pareto button").first.wait_for()
    elif shot.address == "#/runs":
        page.locator("[data-index='0'] a").wait_for()
    else:
        page.locator(".last-runs li").first.wait_for()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--all", action="store_true")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as base:
        os.environ["XDG_STATE_HOME"] = f"{base}/state"
        folder = Path(base) / "cell"
        folder.mkdir()
        run = make_folder(folder)
        chromium = Chromium()
        try:
            with serving(folder) as served, served.client() as client:
                live = stopped_run(client)
                batch = run_batch(client)
                for shot in shots(run, live, batch, every=chosen.all):
                    photograph(chromium, served, shot, chosen.out)
                client.call("live.command", id=live, line="halt")
        finally:
            chromium.close()


if __name__ == "__main__":
    main()
