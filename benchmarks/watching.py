"""Cost and delay of viewers that follow a run: CPU time of the run's own process, digest, and lag.

`python benchmarks/watching.py [--rounds N]` runs one mission without and with three followers in alternation,
and prints medians, ranges and ratios. Then one run at the pace of the clock gives the lag: from the moment
at which the run sends a tick's messages until a follower has read them. A second one has three viewers of the
studio: their lag lasts until the studio has the event for the page.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Any

from picktree.apps.studio.jobs import Jobs
from picktree.apps.studio.live_slice import LiveSlice
from picktree.apps.studio.slice import Studio
from picktree.apps.studio.workspace import Workspace
from picktree.session.attach_socket import SOCKET_NAME, connect_to_run

import orjson

MISSION = Path(__file__).parents[1] / "examples" / "sort_by_colour.yaml"
VIEWERS = 3


def follow(folder: Path, lags: SimpleQueue[list[float]]) -> None:
    """Read everything that the run sends; put the lag of each tick, s."""
    connection = connect_to_run(folder)
    connection.sendall(b'{"steer": false, "follow": true}\n')
    stream = connection.makefile("rb")
    found: list[float] = []
    for line in stream:
        message: dict[str, Any] = json.loads(line)
        for _, _, size in message.get("messages", ()):
            stream.read(size)
        if "wall" in message:
            found.append(time.time() - message["wall"])
    lags.put(found)


def run(
    out: Path, viewers: int, *options: str, look: Callable[[Path], list[float]] | None = None
) -> tuple[dict[str, Any], list[float]]:
    """Run the mission in a process of its own with that many followers; return its result and the lags, s.

    `look` gets the run's folder, and returns further lags.
    """
    words = ["run", str(MISSION), "--scene", "sort_small", "--seed", "7", "--out", str(out), *options]
    process = subprocess.Popen(
        [sys.executable, "-m", "picktree", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    while not (sockets := list(out.glob(f"*/{SOCKET_NAME}"))):
        time.sleep(0.01)
    lags: SimpleQueue[list[float]] = multiprocessing.get_context("fork").SimpleQueue()
    folder = sockets[0].parent
    followers = [
        multiprocessing.get_context("fork").Process(target=follow, args=(folder, lags))
        for _ in range(viewers)
    ]
    for each in followers:
        each.start()
    looked = look(folder) if look is not None else []
    process.wait()
    found = looked + [lag for _ in followers for lag in lags.get()]
    for each in followers:
        each.join()
    return json.loads((folder / "result.json").read_text()), found


async def view(folder: Path) -> list[float]:
    """Watch the run of a folder as three pages of a studio do; return the lag of each event, s."""
    workspace = Workspace(folder.parent)
    live = LiveSlice(Studio(workspace, Jobs(workspace)))
    found: list[float] = []

    async def page() -> None:
        async for event in live.follow(folder.name):
            orjson.dumps(event)
            if isinstance(event, dict) and "wall" in event and "whole" not in event:
                found.append(time.time() - event["wall"])

    await asyncio.gather(*(page() for _ in range(VIEWERS)))
    await live.close()
    return found


def show_lags(lags: list[float], what: str) -> None:
    lags.sort()
    at = {share: lags[min(int(share * len(lags)), len(lags) - 1)] * 1e3 for share in (0.5, 0.99, 1.0)}
    print(f"lag of {len(lags)} {what} at pace 1: " + ", ".join(f"{k:.0%} {v:.1f} ms" for k, v in at.items()))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rounds", type=int, default=5)
    rounds = options.parse_args().rounds
    cpu: dict[int, list[float]] = {0: [], VIEWERS: []}
    digests: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        run(Path(folder) / "first", 0)  # fills the cache
        for number in range(rounds):
            for viewers, seconds in cpu.items():
                result, _ = run(Path(folder) / f"{number}-{viewers}", viewers)
                seconds.append(result["cpu_seconds"])
                digests.add(result["digest"])
        paced, lags = run(Path(folder) / "paced", VIEWERS, "--pace", "1")
        digests.add(paced["digest"])
        shown, seen = run(Path(folder) / "studio", 0, "--pace", "1", look=lambda run: asyncio.run(view(run)))
        digests.add(shown["digest"])
    for viewers, seconds in cpu.items():
        middle, low, high = statistics.median(seconds), min(seconds), max(seconds)
        print(f"{viewers} viewers: CPU {middle:.2f} s ({low:.2f}–{high:.2f}) in {rounds} runs")
    ratios = [with_viewers / alone for alone, with_viewers in zip(cpu[0], cpu[VIEWERS], strict=True)]
    low, middle, high = statistics.quantiles(ratios, n=4)
    print(f"with viewers / without, of one round: median {middle:.3f}, quartiles {low:.3f} and {high:.3f}")
    print(f"digests: {len(digests)} ({'the same' if len(digests) == 1 else 'they differ'})")
    show_lags(lags, "ticks")
    show_lags(seen, "events of the studio")


if __name__ == "__main__":
    main()
