"""Calibration job: scene and target, the run, the estimate from its log, and the corrected scene file."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from ...files.errors import PicktreeError
from ...logs.run_log import RunLog
from ...logs.run_result import RunResult, RunStatus
from ...robot.calibration.estimate import CalibrationEstimate, CameraEstimate, ToolEstimate, estimate
from ...robot.calibration.observations import CalibrationData, TargetImage, TargetTouch
from ...robot.calibration.targets import CalibrationTarget, fingertip_corners, targets
from ...session.observer import Observer
from ...session.recipe import Recipe, Recording
from ...session.session import Session
from ...trees.loading.loader import parse_mission
from ...trees.loading.registry import NodeRegistry
from ...world.journal import Plain
from ...world.robot_model.loading import load_robot
from ...world.robot_model.model import RobotModel
from ...world.scene.description import SceneDescription
from ...world.skill_events import CalibrationShotEvent, CalibrationSkippedEvent, CalibrationTouchEvent
from .corrected_scene import TargetPlacement, calibration_scene, output_file, write

MAX_SHOWN_SKIPS = 4
"""Greatest number of skipped views and touches in the text."""


@dataclass(frozen=True, slots=True)
class CalibrationAnswer:
    """Answer of `picktree calibrate`; m, rad."""

    scene: str
    seed: int
    status: RunStatus
    """Status of the run."""
    folder: Path
    """Folder of the run."""
    skipped: tuple[str, ...] = ()
    """Skipped views and touches, with reasons."""
    unseen: tuple[str, ...] = ()
    """Cameras that did not see the target."""
    known: CalibrationEstimate | None = None
    target_off: tuple[float, float] = (0.0, 0.0)
    """Distance and rotation of the target from its believed pose, m, rad."""
    output: Path | None = None
    """Corrected scene file; None: none was written."""
    why_not: str = ""

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
            more = len(self.skipped) > MAX_SHOWN_SKIPS
            lines.append(f"passed over {len(self.skipped)}{', among them' if more else ''}")
            lines += [f"            {reason}" for reason in self.skipped[:MAX_SHOWN_SKIPS]]
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


def _camera_lines(camera: CameraEstimate) -> list[str]:
    sigma = max(camera.deviation.position)
    angle = max(camera.deviation.angle)
    views = f"{camera.shots} views" if camera.on_hand else "one place"
    return [
        f"{camera.name:<12}was {1000 * camera.moved:.2f} mm and {math.degrees(camera.turned):.2f}° off; "
        f"now known to ± {1000 * sigma:.2f} mm, ± {math.degrees(angle):.2f}°",
        f"            from {views}; left over {camera.pixels:.2f} px, {1000 * camera.depth:.2f} mm of depth",
    ]


def _tool_lines(tool: ToolEstimate) -> list[str]:
    sigma = ", ".join(f"{1000 * s:.2f}" for s in tool.deviation)
    if not tool.sure:
        return [f"tool        left as it was: {tool.touches} touches tell it to ± {sigma} mm only"]
    x, y, z = (1000 * c for c in tool.offset)
    return [
        f"tool        was off by x {x:+.2f}, y {y:+.2f}, z {z:+.2f} mm; now known to ± {sigma} mm",
        f"            from {tool.touches} touches; left over {1000 * tool.left:.2f} mm; "
        "its turn is not felt by the tips",
    ]


def _camera_json(camera: CameraEstimate) -> Plain:
    return {
        "on": "hand" if camera.on_hand else "world",
        "at": list(camera.pose.position),
        "rpy": list(camera.pose.rpy()),
        "moved": camera.moved,
        "turned": camera.turned,
        "deviation": {"position": list(camera.deviation.position), "angle": list(camera.deviation.angle)},
        "views": camera.shots,
        "left": {"pixels": camera.pixels, "depth": camera.depth},
    }


def _tool_json(tool: ToolEstimate) -> Plain:
    return {
        "offset": list(tool.offset),
        "sure": tool.sure,
        "deviation": list(tool.deviation),
        "touches": tool.touches,
        "left": tool.left,
    }


@dataclass(frozen=True, slots=True)
class CalibrationRequest:
    """Request of `picktree calibrate`."""

    scene: str
    cameras: tuple[str, ...] = ()
    """Cameras to calibrate; empty: all of the scene, where those that do not see the target are skipped."""
    touch: bool = True
    """Whether the TCP is calibrated, too."""
    target: str | None = None
    place: TargetPlacement | None = None
    """Place of the added target, where the scene has none; None: a default place."""
    robot: str | None = None
    seed: int = 0
    views: int = 12
    output: Path | None = None
    replace: bool = False
    out: Path | None = None


def calibrate(asked: CalibrationRequest, observers: Sequence[Observer] = ()) -> CalibrationAnswer:
    """Run the calibration and write the corrected scene.

    Raises PicktreeError for an unknown scene, robot, camera or target, and when the file must not be replaced
    or cannot be written. An answer without a file gives the reason.
    """
    output = output_file(asked.scene, asked.output, replace=asked.replace)
    scene = calibration_scene(asked.scene, asked.place)
    target = _target(scene, asked.target)
    cameras = _cameras(scene, asked.cameras)
    if not cameras and not asked.touch:
        raise PicktreeError(f"{asked.scene} has no camera: with --no-tcp there is nothing to calibrate")
    beside = Path.cwd() if asked.robot else Path(scene.source).parent
    robot = load_robot(asked.robot or scene.robot, beside)
    text = mission_text(target.name, cameras, asked.views, touch=asked.touch, all_of_them=not asked.cameras)
    mission = parse_mission(text, Path("calibrate.yaml"), NodeRegistry())
    recipe = Recipe(mission, scene, robot, asked.seed)
    result = Session(recipe, record=Recording(asked.out), observers=observers).run()
    found = _record(result)
    answer = CalibrationAnswer(asked.scene, asked.seed, result.status, result.folder, found.skipped)
    if result.status != "success":
        return replace(answer, why_not=result.message or f"the run ended as {result.status}")
    evidence = CalibrationData(found.shots, found.touches, fingertip_corners(RobotModel(robot)))
    seen = {shot.camera for shot in found.shots}
    answer = replace(answer, unseen=tuple(camera for camera in cameras if camera not in seen))
    try:
        known = estimate(evidence, target.tiles, target.size, target.pose)
    except PicktreeError as error:
        return replace(answer, why_not=str(error))
    when = datetime.now().strftime("%Y-%m-%d %H:%M")
    write(output, asked.scene, asked.robot, scene, known, when, f"picktree calibrate, {result.folder.name}")
    target_off = known.target.distance(target.pose), known.target.angle(target.pose)
    return replace(answer, known=known, target_off=target_off, output=output)


def mission_text(target: str, cameras: Sequence[str], views: int, *, touch: bool, all_of_them: bool) -> str:
    """Return the text of the mission that looks and touches. With `all_of_them` a camera may fail to see the
    target."""
    lines = ["picktree: 1", "kind: mission", "name: calibrate", 'goal: "total >= 0"', "trees:", "  Main:"]
    lines.append("    Sequence:")
    if touch:
        # Touching comes first: the arm is known to get around the target, whatever the cameras see
        # later.
        lines.append(f"      - TouchTarget: {{target: {target}}}")
    for camera in cameras:
        survey = f"Survey: {{target: {target}, camera: {camera}, views: {views}}}"
        lines.append(f"      - ForceSuccess: [{{{survey}}}]" if all_of_them else f"      - {survey}")
    lines.append("      - GoTo: {pose: home}")
    return "\n".join(lines) + "\n"


def _target(scene: SceneDescription, name: str | None) -> CalibrationTarget:
    known = targets(scene.fixtures)
    if name is None and len(known) == 1:
        return known[0]
    for target in known:
        if target.name == name:
            return target
    names = ", ".join(target.name for target in known)
    if name is None:
        raise PicktreeError(f"{scene.name} has several targets: {names}; choose one with --target")
    raise PicktreeError(f"{scene.name} has no target {name!r}; known: {names}")


def _cameras(scene: SceneDescription, wanted: tuple[str, ...]) -> tuple[str, ...]:
    known = tuple(camera.name for camera in scene.cameras)
    for name in wanted:
        if name not in known:
            raise PicktreeError(f"{scene.name} has no camera {name!r}; known: {', '.join(known) or 'none'}")
    # Cameras on the hand come first: their knowledge of the target helps the others.
    on_hand = {camera.name for camera in scene.cameras if camera.on == "hand"}
    return tuple(sorted(dict.fromkeys(wanted or known), key=lambda name: name not in on_hand))


@dataclass(frozen=True, slots=True)
class _Recorded:
    shots: tuple[TargetImage, ...]
    touches: tuple[TargetTouch, ...]
    skipped: tuple[str, ...]


def _record(result: RunResult) -> _Recorded:
    """Return the observations of the target in the run's log. The estimate uses the log alone."""
    shots: list[TargetImage] = []
    touches: list[TargetTouch] = []
    skipped: list[str] = []
    with RunLog(result.log) as log:
        for at in log.events():
            match at.record:
                case CalibrationShotEvent() as event:
                    shots.append(TargetImage.from_event(event))
                case CalibrationTouchEvent() as event:
                    touches.append(TargetTouch.from_event(event))
                case CalibrationSkippedEvent(message=message):
                    skipped.append(message)
                case _:
                    pass
    return _Recorded(tuple(shots), tuple(touches), tuple(skipped))
