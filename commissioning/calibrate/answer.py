"""What a calibration comes to, for the terminal and as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

from ...calibration.estimate import CameraFound, Estimate, ToolFound
from ...logs.run_result import RunStatus
from ...robots.rpy import rpy_of
from ...world.journal import Plain

SHOWN = 4
"""Of what was passed over."""


@dataclass(frozen=True, slots=True)
class CalibrationAnswer:
    """The answer of `picktree calibrate`. m, rad."""

    scene: str
    seed: int
    status: RunStatus
    """Of the run."""
    folder: Path
    """Of the run."""
    skipped: tuple[str, ...] = ()
    """Views and touches that were passed over, and why."""
    unseen: tuple[str, ...] = ()
    """Cameras that did not see the target."""
    known: Estimate | None = None
    target_off: tuple[float, float] = (0.0, 0.0)
    """How far the target stood from where it was believed to be: m, rad."""
    output: Path | None = None
    """The file that was written; None: nothing was."""
    why_not: str = ""

    def without(self, why: str) -> CalibrationAnswer:
        """The answer when nothing comes of it."""
        return replace(self, why_not=why)

    def missing(self, cameras: tuple[str, ...]) -> CalibrationAnswer:
        return replace(self, unseen=cameras)

    def found(self, known: Estimate, target_off: tuple[float, float], output: Path) -> CalibrationAnswer:
        return replace(self, known=known, target_off=target_off, output=output)

    def to_text(self, program: str = "picktree") -> str:
        lines: list[str] = []
        if self.known is not None:
            for camera in self.known.cameras:
                lines += _camera_lines(camera)
            if self.known.tool is not None:
                lines += _tool_lines(self.known.tool)
            off, turned = self.target_off
            lines.append(
                f"target      stood {1000 * off:.1f} mm and {math.degrees(turned):.2f}° from where it was "
                "believed to"
            )
        lines += [f"{name:<12}not calibrated: it does not see the target" for name in self.unseen]
        if self.skipped:
            more = len(self.skipped) > SHOWN
            lines.append(f"passed over {len(self.skipped)}{', among them' if more else ''}")
            lines += [f"            {reason}" for reason in self.skipped[:SHOWN]]
        if self.output is None:
            lines.append(f"not calibrated: {self.why_not}")
        else:
            lines.append(f"written     {self.output}")
            lines.append(f"use it      {program} run MISSION --scene {self.output}")
        lines.append(f"the run     {program} explain {self.folder}")
        return "\n".join(lines)

    def to_json_text(self) -> str:
        known = self.known
        answer: dict[str, Plain] = {
            "scene": self.scene,
            "seed": self.seed,
            "status": self.status,
            "run": str(self.folder),
            "written": None if self.output is None else str(self.output),
            "why_not": self.why_not or None,
            "cameras": {} if known is None else {c.name: _camera_json(c) for c in known.cameras},
            "tcp": None if known is None or known.tool is None else _tool_json(known.tool),
            "target_off": {"position": self.target_off[0], "angle": self.target_off[1]},
            "unseen": list(self.unseen),
            "skipped": list(self.skipped),
        }
        return json.dumps(answer, indent=2, ensure_ascii=False)


def _camera_lines(camera: CameraFound) -> list[str]:
    sigma = max(camera.deviation.position)
    angle = max(camera.deviation.angle)
    views = f"{camera.shots} views" if camera.on_hand else "one place"
    return [
        f"{camera.name:<12}was {1000 * camera.moved:.2f} mm and {math.degrees(camera.turned):.2f}° off; "
        f"now known to ± {1000 * sigma:.2f} mm, ± {math.degrees(angle):.2f}°",
        f"            from {views}; left over {camera.pixels:.2f} px, {1000 * camera.depth:.2f} mm of depth",
    ]


def _tool_lines(tool: ToolFound) -> list[str]:
    sigma = ", ".join(f"{1000 * s:.2f}" for s in tool.deviation)
    if not tool.sure:
        return [f"tool        left as it was: {tool.touches} touches tell it to ± {sigma} mm only"]
    x, y, z = (1000 * c for c in tool.offset)
    return [
        f"tool        was off by x {x:+.2f}, y {y:+.2f}, z {z:+.2f} mm; now known to ± {sigma} mm",
        f"            from {tool.touches} touches; left over {1000 * tool.left:.2f} mm; "
        "its turn is not felt by the tips",
    ]


def _camera_json(camera: CameraFound) -> Plain:
    return {
        "on": "hand" if camera.on_hand else "world",
        "at": list(camera.pose.position),
        "rpy": list(rpy_of(camera.pose)),
        "moved": camera.moved,
        "turned": camera.turned,
        "deviation": {"position": list(camera.deviation.position), "angle": list(camera.deviation.angle)},
        "views": camera.shots,
        "left": {"pixels": camera.pixels, "depth": camera.depth},
    }


def _tool_json(tool: ToolFound) -> Plain:
    return {
        "offset": list(tool.offset),
        "sure": tool.sure,
        "deviation": list(tool.deviation),
        "touches": tool.touches,
        "left": tool.left,
    }
