"""The picture as a page: it stands on its own, and what its scripts lay out does not overlap."""

from __future__ import annotations

import json
import re
import subprocess
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from picktree.authoring import chart
from picktree.authoring.html_drawing import chart_json, html
from picktree.authoring.svg_drawing import PAGE_FOLDER

from ..needs import CHROMIUM, CHROMIUM_PROGRAM, NODE, needs, packages
from ..trees.scripted import mission
from .drawn import outside, overlaps, shift

LIBRARIES = Path(__file__).parents[1] / "trees" / "node"


@cache
def page() -> str:
    return html(shift())


class Page(HTMLParser):
    """Tags with their attributes, and the text of each script."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1][0] == "script" and self.cdata_elem == "script":
            self.scripts[-1] += data


def test_page_needs_nothing_from_elsewhere() -> None:
    tags = Page(page()).tags
    assert [attributes for tag, attributes in tags if tag in ("link", "img", "iframe")] == []
    assert [attributes for tag, attributes in tags if tag == "script" and "src" in attributes] == []
    own = "".join(
        (PAGE_FOLDER / name).read_text() for name in ("viewer.js", "page.js", "arranging.js", "page.css")
    )
    assert not re.search(r"fetch\(|XMLHttpRequest|import |url\(|@import", own)


def test_page_carries_the_whole_chart() -> None:
    data, _ = Page(page()).scripts
    found = json.loads(data)
    assert found == json.loads(json.dumps(chart_json(shift())))
    assert found["order"] == [tree.name for tree in shift().trees]
    grasp = next(node for node in nodes(found["trees"]["SortOne"]["root"]) if node["name"] == "Grasp")
    assert {"grasp.slipped", "safety.*"} <= set(grasp["causes"])
    assert (grasp["place"], grasp["breakpoint"]) == ("shift.yaml:94", "before")
    assert grasp["before"] == [{"key": "_failureIf", "value": "stopped", "role": "rule", "doc": ""}]
    assert "grasp.slipped" in grasp["words"] and "{force}" in grasp["words"]


def nodes(node: dict[str, Any]) -> list[dict[str, Any]]:
    return [node, *(below for child in node["children"] for below in nodes(child))]


def test_no_text_of_a_mission_ends_the_script() -> None:
    name = "</script><!--<script>alert(1)"
    text = html(chart(mission(f"Main: {{Log: {{message: '{name}'}}}}")))
    scripts = Page(text).scripts
    assert len(scripts) == 2
    (log,) = nodes(json.loads(scripts[0])["trees"]["Main"]["root"])
    assert log["ports"][0]["value"] == name


def run_script(program: str) -> Any:
    """Run it after the scripts that lay out, with `chart` and `root` of the shift."""
    scripts = "".join((PAGE_FOLDER / name).read_text() for name in ("libraries.js", "arranging.js"))
    data = json.dumps(chart_json(shift()))
    text = f"{scripts}\nconst chart = {data};\nconst root = rootItem(chart);\n{program}"
    ran = subprocess.run(["node", "-"], input=text, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


@needs(NODE)
@pytest.mark.parametrize(
    ("opened", "least", "most"),
    [("openUpTo(root, 3000)", 430, 449), ("openUpTo(root, 60)", 30, 60), ("", 12, 12)],
)
def test_nothing_overlaps_however_much_is_opened(opened: str, least: int, most: int) -> None:
    found = run_script(
        f"""{opened};
arrange(root);
const frames = [...root.shown()].filter((item) => item.isFrame).map((frame) => {{
  const items = [...inFrame(frame.children[0])];
  const bodies = items.map((i) => [i.x + i.room, i.y, i.width, i.height]);
  const pills = items.filter((i) => i.node.pill).map((i) => {{
    const {{ width, height }} = i.node.pill;
    return [i.x, i.middle - height / 2, width, height];
  }});
  const top = frame.node.header.height;
  return {{ path: frame.path, size: [0, top, frame.width, frame.height - top], rects: bodies.concat(pills) }};
}});
console.log(JSON.stringify({{ frames, shown: [...root.shown()].length }}));"""
    )
    for frame in found["frames"]:
        assert outside(frame["size"], frame["rects"]) == [], frame["path"]
        assert overlaps(frame["rects"]) == [], frame["path"]
    assert least <= found["shown"] <= most


@needs(NODE)
def test_search_finds_nodes_of_closed_sub_trees_by_their_paths() -> None:
    found = run_script(
        """const paths = searchPaths(root, (node) => node.words.includes("condition known"), 50);
const item = root.find(paths[0]);
console.log(JSON.stringify({ paths, name: item.node.title }));"""
    )
    stem = "Main/the whole shift/Repeat/Sequence/ForEach/HandleOne/IfThenElse"
    assert found["paths"][0] == f"{stem}/Switch/SortGently/Sequence/Fallback/known well enough"
    assert len(found["paths"]) == 4
    assert found["name"] == "Condition known well enough"


@needs(packages("trees"))
def test_libraries_are_what_their_recipe_makes(tmp_path: Path) -> None:
    made = tmp_path / "libraries.js"
    subprocess.run(
        ["sh", "-c", f"OUT={made} npm run --silent build"], cwd=LIBRARIES, check=True, capture_output=True
    )
    assert made.read_bytes() == (PAGE_FOLDER / "libraries.js").read_bytes()


@pytest.mark.slow
@needs(CHROMIUM)
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_a_browser_opens_searches_and_walks_it_by_keys(width: int, height: int, tmp_path: Path) -> None:
    script = """
const said = [];
addEventListener("error", (event) => said.push(event.message));
addEventListener("load", () => {
  const drawing = picktreeDrawing;
  const cut = [];
  const check = () => {
    for (const group of drawing.svg.querySelectorAll(".node:not(.frame)")) {
      const box = group.querySelector(".box").getBBox();
      for (const text of group.querySelectorAll("text")) {
        if (text.getBBox().x + text.getBBox().width > box.width) cut.push(group.dataset.path);
      }
    }
  };
  const key = (name) => drawing.groups.get(drawing.selected)
    .dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true }));
  check();
  document.getElementById("search").value = "harder";
  document.getElementById("search").dispatchEvent(new Event("input"));
  const found = document.getElementById("count").textContent;
  const first = drawing.selected;
  key("ArrowLeft"); key("Enter");
  const parent = drawing.selected;
  const closed = drawing.groups.get(parent).getAttribute("aria-expanded");
  drawing.setStatuses({ Main: "RUNNING" });
  const running = drawing.groups.get("Main").classList.contains("running");
  document.getElementById("open").click();
  check();
  const details = document.getElementById("details").textContent;
  const wide = document.documentElement.scrollWidth;
  document.body.innerHTML = "<pre>" + JSON.stringify(
    { said, cut, found, first, parent, closed, running, wide, details }
  ).replace(/</g, "&lt;") + "</pre>";
});
"""
    file = tmp_path / "page.html"
    file.write_text(page().replace("</body>", f"<script>{script}</script></body>"), encoding="utf-8")
    ran = subprocess.run(
        [CHROMIUM_PROGRAM or "", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}",
         f"--window-size={width},{height}", "--dump-dom", file.as_uri()],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    (told,) = re.findall(r"<pre>(\{.*?)</pre>", ran.stdout, re.DOTALL)
    found = json.loads(told.replace("&gt;", ">").replace("&lt;", "<").replace("&amp;", "&"))
    assert (found["said"], found["cut"]) == ([], [])
    assert found["found"] == "1 of 4"
    assert found["first"].endswith("/SortOne/Recover/grasp.slipped/SetBlackboard")
    assert found["first"].removesuffix("/SetBlackboard") == found["parent"]
    assert (found["closed"], found["running"]) == ("false", True)
    assert "place" in found["details"]
    assert found["wide"] <= max(width, 500)
