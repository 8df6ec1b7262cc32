"""A headless Chromium that opens reports: one for all tests, each page in a context of its own."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .needs import CHROMIUM_PROGRAM

FLAGS = (
    "--no-sandbox",  # as root, in containers
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--use-angle=swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-gpu-compositing",  # what is no WebGL is drawn without its emulation
)
_EMULATED = "GL Driver Message"
"""Part of the warnings about the pace of emulated WebGL."""
READY = "html[data-ready=yes]"
PATIENCE = 300.0
"""Wall seconds after which something that is waited for will not come, however busy the machine is."""


@dataclass
class Told:
    """What a page said and asked for while it was open."""

    problems: list[str] = field(default_factory=list)
    """Errors and warnings of the console, and exceptions that nobody caught."""
    requests: list[str] = field(default_factory=list)
    """Addresses other than the page's own."""


class Chromium:
    """`page(file)` opens a file and waits until the report is ready."""

    def __init__(self) -> None:
        from playwright.sync_api import sync_playwright

        self._playwright = sync_playwright().start()
        self._browser = self._playwright.chromium.launch(executable_path=CHROMIUM_PROGRAM, args=list(FLAGS))

    def close(self) -> None:
        self._browser.close()
        self._playwright.stop()

    @contextmanager
    def page(
        self,
        file: Path,
        size: tuple[int, int] = (1280, 800),
        at: str = "",
        *,
        dark: bool = False,
        touch: bool = False,
        scale: float = 1.0,
        script: str = "",
    ) -> Iterator[tuple[Any, Told]]:
        """The page, and what it says. `at` is a hash, such as `#t=2.5`; `script` runs before its own."""
        own = file.absolute().as_uri()
        with self.blank(own, size, dark=dark, touch=touch, scale=scale, script=script) as (page, told):
            page.goto(own + at)
            page.wait_for_selector(READY, state="attached")
            yield page, told

    @contextmanager
    def blank(
        self,
        own: str,
        size: tuple[int, int] = (1280, 800),
        *,
        dark: bool = False,
        touch: bool = False,
        scale: float = 1.0,
        script: str = "",
    ) -> Iterator[tuple[Any, Told]]:
        """An empty page of a context of its own; requests to other addresses than `own` are noted."""
        context = self._browser.new_context(
            viewport={"width": size[0], "height": size[1]},
            color_scheme="dark" if dark else "light",
            has_touch=touch,
            device_scale_factor=scale,
            reduced_motion="reduce",
        )
        context.set_default_timeout(PATIENCE * 1000)
        told = Told()
        page = context.new_page()
        if script:
            page.add_init_script(script)
        page.on(
            "console",
            lambda m: (
                told.problems.append(m.text)
                if m.type in ("error", "warning") and _EMULATED not in m.text
                else None
            ),
        )
        page.on("pageerror", lambda error: told.problems.append(str(error)))
        page.on(
            "request", lambda r: told.requests.append(r.url) if not r.url.startswith((own, "blob:")) else None
        )
        try:
            yield page, told
        finally:
            context.close()


def wait_until(page: Any, expression: str, seconds: float = PATIENCE) -> bool:
    """Wait until an expression is true in the page, then return True. Raises AssertionError when it never is.

    The page's policy forbids `page.wait_for_function`."""
    if not _comes_true(page, expression, seconds):
        raise AssertionError(f"never true in the page: {expression}")
    return True


def on_top(page: Any, selector: str) -> bool:
    """Return whether the middle of the element is on the screen, with nothing of another element over it.

    A page may still move, and gets time for it.
    """
    expression = f"""(() => {{
        const one = document.querySelector({json.dumps(selector)});
        const {{ left, top, width, height }} = one.getBoundingClientRect();
        return one.contains(document.elementFromPoint(left + width / 2, top + height / 2));
    }})()"""
    return _comes_true(page, expression, 20.0)


def _comes_true(page: Any, expression: str, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        if time.monotonic() > end:
            return False
        page.wait_for_timeout(20)
    return True


def frames(page: Any, count: int) -> None:
    """Wait until the page has drawn so many more frames."""
    page.evaluate(
        """(count) => new Promise((done) => {
            const next = (left) => left > 0 ? requestAnimationFrame(() => next(left - 1)) : done();
            next(count);
        })""",
        count,
    )
