"""Hooks of mkdocs: the README as first page, a page for each code of `picktree check`, and links to both."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
CODES = "files/pages/"
LOOKED_UP = ("Reference", "Figures")
"""Groups of pages in which one looks something up: the search finds the guides before them."""
LOOKED_UP_BOOST = 0.2
"""Weight of these pages in the search; that of a guide is 1."""
_LINK = re.compile(r"(?P<image>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\]\([^)]*\))*)\]\((?P<target>[^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are not in docs/."""
    files.append(File.generated(config, "index.md", content=_page(ROOT / "README.md")))
    for page in sorted((ROOT / CODES).glob("*.md")):
        files.append(File.generated(config, f"codes/{page.name}", content=_page(page)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links to where the site has their pages; a file that the site does not have is only named.

    Pages of groups in which one looks something up weigh less in the search.
    """
    source = page.file.src_uri
    if source.startswith("codes/") or any(group.title in LOOKED_UP for group in page.ancestors):
        page.meta["search"] = {"boost": LOOKED_UP_BOOST}
    if source == "index.md":
        folder = ROOT
    else:
        folder = ROOT / CODES if source.startswith("codes/") else (ROOT / "docs" / source).parent
    up = "../" * source.count("/")
    return _LINK.sub(lambda found: _led(found, folder, up), markdown)


def _led(found: re.Match[str], folder: Path, up: str) -> str:
    target, _, anchor = found["target"].partition("#")
    text = _inner(found["text"], folder, up)
    if not target or "://" in target:
        return found[0]
    path = (folder / target).resolve()
    if not path.is_relative_to(ROOT):
        return text
    name = path.relative_to(ROOT).as_posix()
    hash_ = f"#{anchor}" if anchor else ""
    if name == "README.md":
        name = "docs/index.md"
    if name.startswith(CODES):
        name = f"docs/codes/{path.name}"
    if not name.startswith("docs/") or path.is_dir():
        return text
    return f"{found['image']}[{text}]({up}{name.removeprefix('docs/')}{hash_})"


def _inner(text: str, folder: Path, up: str) -> str:
    """Lead the links inside a link's text, as of a picture that is a link."""
    return _LINK.sub(lambda found: _led(found, folder, up), text)


def _page(path: Path) -> str:
    return path.read_text(encoding="utf-8")
