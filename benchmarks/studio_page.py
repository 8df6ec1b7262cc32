"""Page of the studio in Chromium: wall times of a mission of a thousand nodes, and of an index of many runs.

    python benchmarks/studio_page.py --rounds 9 LOG --runs 10000

The mission has the tree that sorts one item of `examples/sort_by_colour.yaml` many times over. Times end when
the page has drawn: open, from the address to the cards; pan and zoom, from frame to frame while the mouse
moves the picture, as opened and with all nodes in view; fold, the longest of twelve frames around the key;
edit, from the key to the change in the other view. The runs are folders with hard links to LOG; `cold`:
nothing of them is in the cache. A busy machine stretches wall times: where it says CPU, that is the CPU time
of the studio and of all processes of Chromium.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from statistics import median, quantiles
from tempfile import TemporaryDirectory
from typing import Any

from _campaign import ROOT
from picktree.files.disk_cache import VARIABLE

import psutil

sys.path.insert(0, str(ROOT))
from tests.browser import Chromium, wait_until

EXAMPLE = ROOT / "examples" / "sort_by_colour.yaml"
COPIES = 40
NAME = "large.yaml"
FRAMES = 60

FRAME = """new Promise((done) =>
  requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now()))))"""
DRAG = f"""new Promise((done) => {{
  const pane = document.querySelector(".react-flow__pane"), box = pane.getBoundingClientRect(), times = [];
  let [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  const mouse = (type, target) => target.dispatchEvent(new MouseEvent(type, {{
    bubbles: true, cancelable: true, view: window, clientX: x, clientY: y, button: 0, buttons: 1 }}));
  mouse("mousedown", pane);
  const step = (now) => {{
    times.push(now);
    if (times.length > {FRAMES}) {{ mouse("mouseup", window); done(times); return; }}
    x += times.length % 40 < 20 ? -9 : 9; y += times.length % 20 < 10 ? 7 : -7;
    mouse("mousemove", window);
    requestAnimationFrame(step);
  }};
  requestAnimationFrame(step);
}})"""
WHEEL = f"""new Promise((done) => {{
  const pane = document.querySelector(".react-flow__pane"), box = pane.getBoundingClientRect(), times = [];
  const step = (now) => {{
    times.push(now);
    if (times.length > {FRAMES}) {{ done(times); return; }}
    pane.dispatchEvent(new WheelEvent("wheel", {{ bubbles: true, cancelable: true, view: window,
      clientX: box.x + box.width / 2, clientY: box.y + box.height / 2,
      deltaY: times.length % 30 < 15 ? -30 : 30 }}));
    requestAnimationFrame(step);
  }};
  requestAnimationFrame(step);
}})"""
# Spans of the frames from the one before a key on.
FOLD = """void (globalThis.frames = new Promise((done) => {
  const times = [];
  let pressed = Infinity;
  addEventListener("keydown", () => { pressed = times.length; }, { capture: true, once: true });
  const step = (now) => {
    times.push(now);
    if (times.length < pressed + 12) { requestAnimationFrame(step); return; }
    done(times.slice(pressed).map((each, number) => each - times[pressed + number - 1]));
  };
  requestAnimationFrame(step);
}))"""
# Zooms in to where cards are drawn as such, which is where most of them are.
NEARER = """new Promise((done) => {
  const pane = document.querySelector(".react-flow__pane"), box = pane.getBoundingClientRect();
  const step = () => {
    if (document.querySelector(".react-flow__node")) { done(); return; }
    pane.dispatchEvent(new WheelEvent("wheel", { bubbles: true, cancelable: true, view: window,
      clientX: box.x + box.width / 2, clientY: box.y + box.height / 2, deltaY: -20 }));
    requestAnimationFrame(step);
  };
  step();
})"""
# Chooses the card with children that is nearest to the middle.
CHOOSE = """(() => {
  const box = document.querySelector(".react-flow__pane").getBoundingClientRect();
  const away = (card) => {
    const at = card.getBoundingClientRect();
    return Math.hypot(at.x - box.x - box.width / 2, at.y - box.y - box.height / 2);
  };
  const cards = [...document.querySelectorAll(".tree-card")];
  cards.filter((card) => card.querySelector(".tree-fold")).sort((a, b) => away(a) - away(b))[0].click();
})()"""
# From the key to the moment at which an element's text has words that it had not.
WATCH = """([key, selector, words]) => { globalThis.took = null;
  addEventListener("keydown", (event) => {
    if (event.key !== key) return;
    const began = performance.now();
    const look = () => {
      const found = [...document.querySelectorAll(selector)].some((each) => each.textContent.includes(words));
      if (found) globalThis.took = performance.now() - began;
      else requestAnimationFrame(look);
    };
    look();
  }, { capture: true, once: true }); }"""


def large_mission(copies: int) -> str:
    """Return a mission with that many trees of 26 nodes."""
    head, _, tree = EXAMPLE.read_text(encoding="utf-8").partition("  SortOne:\n")
    calls = ", ".join(f'{{Sort{n}: {{item: "{{item}}"}}}}' for n in range(copies))
    head = head.replace('{SortOne: {item: "{item}"}}', f"{{Sequence: [{calls}]}}")
    return head + "".join(f"  Sort{n}:\n{tree}\n" for n in range(copies))


@contextmanager
def studio(folder: Path) -> Generator[str]:
    """Serve a folder in a process of its own; yield the link."""
    words = [sys.executable, "-m", "picktree", "studio", str(folder), "--port", "0", "--no-browser"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.stdout.readline().strip()
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def show(what: str, times: list[float], cpu: float | None = None) -> None:
    """Print median, smallest and largest of some times, ms; `cpu`: CPU time of all of them, s."""
    spent = "" if cpu is None else f", CPU {cpu / len(times) * 1e3:.0f} ms each"
    print(f"{what:<34}{median(times):7.0f} ms   ({min(times):.0f}–{max(times):.0f}){spent}")


def cpu_time() -> float:
    """Return the CPU time of the studio and the browser, s."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            spent = process.cpu_times()
            total += spent.user + spent.system
    return total


def show_frames(what: str, page: Any, script: str) -> None:
    """Print how many frames a second a page draws while a script moves its picture."""
    before = cpu_time()
    stamps = page.evaluate(script)
    spent = (cpu_time() - before) / FRAMES * 1e3
    spans = [after - before for before, after in pairwise(stamps)]
    cards = page.locator(".react-flow__node").count()
    ninth = quantiles(spans, n=10)[-1]
    rate = 1000 / (sum(spans) / len(spans))
    drawn = f"nine of ten below {ninth:.0f} ms, CPU {spent:.0f} ms each, {cards} cards"
    print(f"{what:<34}{rate:7.0f} frames/s, {drawn}")


def open_mission(page: Any, link: str) -> float:
    """Open the large mission from the start page; return the time until its cards are drawn, ms."""
    page.goto(link.partition("?")[0] + "#/")
    page.wait_for_selector("main h1, main h2")
    page.wait_for_timeout(300)
    page.evaluate(f"""globalThis.began = performance.now(); location.hash = "#/write/{NAME}" """)
    page.wait_for_selector(".tree-card")
    return page.evaluate(f"{FRAME}.then((now) => now - globalThis.began)")


def wait_checked(page: Any) -> None:
    page.locator(".write-faults", has_text="fault").or_(page.locator(".write-faults b")).first.wait_for()
    page.get_by_text("Checking…").wait_for(state="detached")


def show_whole(page: Any) -> None:
    page.locator(".react-flow__controls-fitview").click()
    page.wait_for_timeout(500)


def measure_picture(page: Any, link: str, rounds: int) -> None:
    """Measure how a large mission is opened and moved."""
    show("open", [open_mission(page, link) for _ in range(rounds)])
    wait_checked(page)
    show_frames("pan, as opened", page, DRAG)
    show_whole(page)
    show_frames("pan, all in view", page, DRAG)
    show_frames("zoom, all in view", page, WHEEL)
    show_whole(page)
    page.evaluate(NEARER)
    page.wait_for_timeout(500)
    show_frames("pan, most cards in view", page, DRAG)


def measure_folds(page: Any, link: str, rounds: int) -> None:
    """Measure how a large mission, and a tree of it, are folded and unfolded."""

    def longest_frame(key: str) -> float:
        page.evaluate(FOLD)
        page.wait_for_timeout(100)
        page.keyboard.press(key)
        return max(page.evaluate("globalThis.frames"))

    def fold_often(what: str) -> None:
        page.locator(".tree-keys").focus()
        page.wait_for_timeout(300)
        before = cpu_time()
        times = [longest_frame("-+"[number % 2]) for number in range(2 * rounds)]
        show(what, times, cpu_time() - before)

    open_mission(page, link)
    wait_checked(page)
    page.locator(".tree-keys").focus()
    page.keyboard.press("Home")
    fold_often("fold all, as opened")
    for key in ("ArrowRight", "ArrowDown", "ArrowRight"):
        page.keyboard.press(key)
    fold_often("fold a tree, as opened")
    show_whole(page)
    fold_often("fold a tree, all in view")
    page.keyboard.press("Home")
    fold_often("fold all, all in view")
    show_whole(page)
    page.evaluate(NEARER)
    page.wait_for_timeout(500)
    page.evaluate(CHOOSE)
    page.locator(".tree-card.selected").wait_for()
    fold_often("fold a tree, most cards in view")


def measure_edits(page: Any, rounds: int) -> None:
    """Measure edits of one value of the mission that is open: in the text, then in the form."""
    card = '[data-tree-node="Sort0/Recover"]'

    def took(shown_in: str, text: str, key: str) -> float:
        page.evaluate(WATCH, [key, shown_in, text])
        page.keyboard.press(key)
        wait_until(page, "globalThis.took !== null")
        return page.evaluate("globalThis.took")

    def typed(sevens: int) -> float:
        return took(card, f"attempts: 4{'7' * sevens}", "7")

    def paused(one: Callable[[int], float]) -> list[float]:
        times: list[float] = []
        for number in range(rounds):
            times.append(one(number))
            page.wait_for_timeout(700)
        return times

    page.reload()
    page.wait_for_selector(".tree-card")
    page.get_by_text("Checking…").wait_for(state="detached")
    page.locator(".cm-line", has_text="attempts: 4").first.click()
    page.keyboard.press("End")
    page.locator(card).wait_for()
    page.wait_for_timeout(1500)
    show("edit, text to picture", paused(lambda number: typed(number + 1)))
    show("edit, without a pause", [typed(rounds + number + 1) for number in range(rounds)])
    page.wait_for_timeout(1500)
    page.locator(card).click()
    field = page.get_by_label("attempts", exact=True)

    def filled(number: int, shown_in: str) -> float:
        field.fill(f"{number}")
        return took(shown_in, f"attempts: {number}", "Enter")

    show("edit, form to text", paused(lambda number: filled(number + 11, ".cm-line")))
    show("edit, form to picture", paused(lambda number: filled(number + 41, card)))


# From the load of the page, or from a key, to the moment at which the table has what is asked.
ROWS = """new Promise((done) => { const look = () => {
  if (document.querySelector(".table-body [role=row] a")) done(performance.now());
  else requestAnimationFrame(look); }; look(); })"""


def measure_index(page: Any, link: str, runs: int, rounds: int) -> None:
    page.goto(link)
    page.wait_for_selector("main h1, main h2")

    def first_rows() -> float:
        page.goto("about:blank")
        page.goto(link.partition("?")[0] + "#/runs", wait_until="commit")
        return page.evaluate(ROWS)

    before = cpu_time()
    print(f"{'first rows, cold':<34}{first_rows():7.0f} ms")
    times = [first_rows() for _ in range(3)]
    show("first rows, during the first look", times)
    found = page.locator(".found")
    began = time.monotonic()
    found.get_by_text(f"{runs} runs", exact=True).wait_for()
    took = f"{time.monotonic() - began:.1f} s, CPU {cpu_time() - before:.1f} s"
    print(f"{'the first look, wall from here':<34}{took:>9}")
    show("first rows, looked at", [first_rows() for _ in range(rounds)])

    def filtered(label: str, letters: str, wanted: str, after: str) -> float:
        page.evaluate(WATCH, [after, ".found", wanted])
        page.get_by_label(label).press(letters)
        wait_until(page, "globalThis.took !== null", 60)
        return page.evaluate("globalThis.took")

    times.clear()
    conditions: list[float] = []
    for number in range(rounds):
        page.get_by_label("Words").fill("")
        found.get_by_text(f"{runs} runs", exact=True).wait_for()
        page.get_by_label("Words").fill(f"run-{number}")
        page.wait_for_timeout(600)
        times.append(filtered("Words", "x", f"0 of {runs} runs", "x"))
        page.get_by_label("Words").fill("")
        found.get_by_text(f"{runs} runs", exact=True).wait_for()
        page.get_by_label("Condition").fill(
            f"lost >= 0 and 'x' not in causes and folder != 'run-{number}-20261123-090000'"
        )
        conditions.append(filtered("Condition", "Enter", f" of {runs} runs", "Enter"))
        page.get_by_label("Condition").fill("")
        found.get_by_text(f"{runs} runs", exact=True).wait_for()
    show("filter, words", times)
    show("filter, condition", conditions)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", type=Path, nargs="?", help="without it: the mission alone")
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--folds", action="store_true", help="measure of the mission only how it is folded")
    parser.add_argument("--slower", type=float, default=1, help="times that the page's thread is slowed")
    chosen = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    chromium = Chromium()
    with TemporaryDirectory(dir=chosen.log.parent if chosen.log else None) as base:
        os.environ.update({"XDG_STATE_HOME": f"{base}/state", VARIABLE: f"{base}/cache"})
        folder = Path(base) / "folder"
        folder.mkdir()
        (folder / NAME).write_text(large_mission(COPIES), encoding="utf-8")
        with studio(folder) as link, chromium.blank(link) as (page, _):
            page.set_default_timeout(60_000)
            cdp = page.context.new_cdp_session(page)
            cdp.send("Emulation.setCPUThrottlingRate", {"rate": chosen.slower})
            page.goto(link)
            if not chosen.folds:
                measure_picture(page, link, chosen.rounds)
            measure_folds(page, link, chosen.rounds)
            if not chosen.folds:
                measure_edits(page, chosen.rounds)
        if chosen.log:
            for number in range(chosen.runs):
                run = folder / "runs" / f"run-{number}-20261123-090000"
                run.mkdir(parents=True)
                os.link(chosen.log, run / "log.mcap")
            with studio(folder) as link, chromium.blank(link) as (page, _):
                page.set_default_timeout(120_000)
                measure_index(page, link, chosen.runs, chosen.rounds)
    chromium.close()
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
