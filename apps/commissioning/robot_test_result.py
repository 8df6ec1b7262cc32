"""Result of a robot's self-test: a table for the terminal, JSON, and a page of its own."""

from __future__ import annotations

import base64
import json
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from ...analysis.render.snapshot import draw_robot
from ...files.atomic_write import whole
from ...world.robot_model.description import RobotDescription
from .model_checks import Verdict

STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .5rem .7rem; border-bottom: 1px solid #8886; }
td { overflow-wrap: anywhere; }
td:first-child, td.good, td.bad { white-space: nowrap; }
td.good { color: #188038; font-weight: 600; }
td.bad { color: #c5221f; font-weight: 600; }
.change { margin-top: .25rem; font-weight: 600; }
.both { display: flex; flex-wrap: wrap; gap: 2rem; }
.both > :first-child { flex: 3 1 32rem; }
img { flex: 1 1 18rem; max-width: 26rem; align-self: flex-start; border-radius: .5rem; }
@media (prefers-color-scheme: dark) { td.good { color: #81c995; } td.bad { color: #f28b82; } }
"""


@dataclass(frozen=True, slots=True)
class RobotTestResult:
    """Verdicts of a self-test of one robot."""

    name: str
    file: str
    verdicts: tuple[Verdict, ...]

    @property
    def good(self) -> bool:
        """Whether all verdicts are good."""
        return all(verdict.good for verdict in self.verdicts)

    @property
    def summary(self) -> str:
        """Sentence about all verdicts."""
        failed = [verdict.name for verdict in self.verdicts if not verdict.good]
        if not failed:
            return f"all {len(self.verdicts)} tests are passed"
        return f"{len(failed)} of {len(self.verdicts)} tests failed: {', '.join(failed)}"

    def to_text(self) -> str:
        lines = [f"{self.name}: {self.summary}"]
        width = max(len(verdict.name) for verdict in self.verdicts)
        for v in self.verdicts:
            lines.append(f"  {'ok    ' if v.good else 'FAILED'}  {v.name:<{width}}  {v.measured}")
            if v.change:
                lines.append(f"  {'':6}  {'':<{width}}  to change: {v.change}")
        return "\n".join(lines)

    def to_json_text(self) -> str:
        return json.dumps({**asdict(self), "good": self.good}, ensure_ascii=False)

    def write_page(self, robot: RobotDescription, file: Path) -> None:
        """Write the page, with a picture of the robot at `home`. Raises PicktreeError when it cannot be
        written."""
        with TemporaryDirectory() as folder:
            drawn = Path(folder) / "robot.png"
            draw_robot(robot, drawn)
            picture = base64.b64encode(drawn.read_bytes()).decode()
        with whole([file], file) as (beside,):
            beside.write_text(self.to_html(picture), encoding="utf-8")

    def to_html(self, picture: str) -> str:
        """Return the page; `picture`: a PNG in base 64."""
        rows = "\n".join(
            f"<tr><td>{escape(v.name)}</td>"
            f"<td class={'good' if v.good else 'bad'}>{'ok' if v.good else 'failed'}</td>"
            f"<td>{escape(v.measured)}"
            + (f'<div class="change">To change: {escape(v.change)}</div>' if v.change else "")
            + "</td></tr>"
            for v in self.verdicts
        )
        title = f"Self-test of {escape(self.name)}"
        return (
            f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{title}</title>\n'
            f"<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
            f"<p>{escape(self.file)}: {escape(self.summary)}.</p>\n"
            f'<div class="both"><table>\n<tr><th>Test</th><th>Verdict</th><th>Measured</th></tr>\n{rows}\n'
            f'</table><img alt="The robot at home, with base, flange and TCP" '
            f'src="data:image/png;base64,{picture}"></div>\n</body>\n</html>\n'
        )
