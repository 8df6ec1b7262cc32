"""Calibration: scene and target, the run, the estimate from its log, and the corrected scene file."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from os.path import relpath
from pathlib import Path

import yaml

from picktree.files import PicktreeError, file_system
from picktree.logs import RunLog, RunResult, RunStatus
from picktree.robot.calibration import (
    CalibrationEstimate,
    CameraEstimate,
    ToolEstimate,
    calibration_targets,
    estimate,
    observations,
)
from picktree.robot.perception import table_of
from picktree.session import Observer, Session, run_recipe
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import Plain, Pose, Vector3, event_types, top
from picktree.world.robot_model import RobotModel, load_robot, robot_file
from picktree.world.scene import SceneDescription, load_scene, parse_scene, scene_loading

from .target_syntax import quantity

TARGET_NAME = "calibration_target"
TARGET_SIZE = (0.18, 0.16, 0.05)
"""Size of the target that is added to the scene, m."""
TARGET_YAW = math.radians(20.0)
"""Rotation of the added target about z, rad: edges along a camera's rows of pixels are measured worst."""
TARGET_UNCERTAINTY = (0.005, math.radians(2.0))
"""Uncertainty of the added target's pose, m and rad: the accuracy of its placement by hand."""
DEFAULT_TARGET_DISTANCE = 0.5
"""Distance of the target in front of the origin when no area for items gives a better place, m."""


@dataclass(frozen=True, slots=True)
class TargetPlacement:
    """Place of a target, m and rad."""

    x: float
    y: float
    yaw: float = TARGET_YAW


def parse_place(text: str) -> TargetPlacement:
    """Parse a placement such as `0.5,0,20deg`: x and y, optionally the yaw. Raises PicktreeError.

    >>> parse_place("500 mm,0")
    TargetPlacement(x=0.5, y=0.0, yaw=0.3490658503988659)
    """
    parts = text.split(",")
    if len(parts) not in (2, 3):
        raise PicktreeError(f"--at {text}: write X,Y or X,Y,YAW, as in --at 0.5,0,20deg")
    x, y, *yaw = (quantity("--at", part.strip(), unit) for part, unit in zip(parts, ("m", "m", "rad")))  # noqa: B905
    return TargetPlacement(x, y, yaw[0] if yaw else TARGET_YAW)


def calibration_scene(name: str, place: TargetPlacement | None) -> SceneDescription:
    """Return the scene without its items, with an added target where it has none. The text of the scene is
    complete, for the log. Raises PicktreeError."""
    path = file_system.find_file(name, scene_loading.SHIPPED, Path.cwd(), "scene")
    scene = load_scene(name, Path.cwd())
    base = path.stem if path.parent == scene_loading.SHIPPED else str(path.resolve())
    own: dict[str, object] = {"picktree": 1, "kind": "scene", "base": base}
    if scene.spawn:
        own["spawn"] = None
    if scene.deliveries:
        own["feed"] = None
    if not calibration_targets.targets(scene.fixtures):
        own["fixtures"] = {TARGET_NAME: _target_fixture(scene, place or _middle(scene))}
    beside = Path.cwd() if path.parent == scene_loading.SHIPPED else path.parent
    return parse_scene(yaml.safe_dump(own, sort_keys=False), beside / f"{path.stem}.yaml")


def _target_fixture(scene: SceneDescription, place: TargetPlacement) -> dict[str, object]:
    table = table_of(scene)
    ground = 0.0 if table is None else top(table.shape, table.pose)
    return {
        "marker": list(TARGET_SIZE),
        "at": [place.x, place.y, ground + TARGET_SIZE[2] / 2],
        "yaw": place.yaw,
        "uncertainty": {"position": TARGET_UNCERTAINTY[0], "angle": TARGET_UNCERTAINTY[1]},
    }


def _middle(scene: SceneDescription) -> TargetPlacement:
    """Return the middle of the first area for items: cameras look there and the arm reaches it."""
    for load in scene.loads:
        (x0, y0), (x1, y1) = load.rectangle
        return TargetPlacement((x0 + x1) / 2, (y0 + y1) / 2)
    return TargetPlacement(DEFAULT_TARGET_DISTANCE, 0.0)


DECIMAL_DIGITS = 7
"""Number of digits after the decimal point: 0.1 µm, 0.1 µrad."""


def output_file(scene: str, wanted: Path | None, *, replace: bool) -> Path:
    """Return the path of the corrected scene. Raises PicktreeError where it cannot be written."""
    path = file_system.find_file(scene, scene_loading.SHIPPED, Path.cwd(), "scene")
    if wanted is None:
        here = path.parent == scene_loading.SHIPPED or path.parent.resolve() == Path.cwd()
        folder = Path() if here else path.parent
        wanted = folder / f"{path.stem}_calibrated.yaml"
    if wanted.suffix not in (".yaml", ".yml"):
        raise PicktreeError(f"-o {wanted}: a scene file ends in .yaml")
    if wanted.exists() and wanted.resolve() == path.resolve():
        raise PicktreeError(
            f"-o {wanted} is the scene itself, which the new file needs as its base; name another file"
        )
    if wanted.is_dir() or not (wanted.absolute().parent).is_dir():
        raise PicktreeError(f"{wanted} cannot be written: there is no such folder")
    if wanted.exists() and not replace:
        raise PicktreeError(f"{wanted} exists; --replace writes over it, -o names another file")
    return wanted


def write(
    output: Path,
    name: str,
    robot: str | None,
    scene: SceneDescription,
    found: CalibrationEstimate,
    when: str,
    by: str,
) -> None:
    """Write the corrected scene: `base:` and `calibration:`, with the standard deviation above each value.

    `scene` is the calibrated scene, `robot` the robot that replaced its own. Raises PicktreeError when the
    disk refuses; then no file remains.
    """
    path = file_system.find_file(name, scene_loading.SHIPPED, Path.cwd(), "scene")
    tool = found.tool if found.tool is not None and found.tool.sure else None
    shift = Pose() if tool is None else Pose(tool.offset)
    lines = ["picktree: 1", "kind: scene", f"base: {_named(path, scene_loading.SHIPPED, output)}"]
    if robot is not None:
        file = file_system.find_file(robot, robot_file.SHIPPED, Path.cwd(), "robot")
        lines.append(f"robot: {_named(file, robot_file.SHIPPED, output)}")
    lines += ["", "calibration:", f"  date: {when}", f"  by: {by}"]
    kept = _uncalibrated_hand_cameras(scene, found, shift)
    if found.cameras or kept:
        lines.append("  cameras:")
    for camera in found.cameras:
        lines += [f"    # {_deviation_comment(camera)}", f"    {camera.name}: {_pose_text(camera.pose)}"]
    for camera, pose in kept:
        lines += [
            "    # Kept from the last calibration, and converted to the TCP of this one.",
            f"    {camera}: {_pose_text(pose)}",
        ]
    if tool is not None:
        tcp = scene.tool @ shift
        sigma = ", ".join(f"{1000 * s:.3f}" for s in tool.deviation)
        turn = "" if tcp.rpy() == (0.0, 0.0, 0.0) else f", rpy: {_list(tcp.rpy())}"
        lines += [
            f"  # ± {sigma} mm along x, y, z, from {tool.touches} touches; touching does not "
            "measure the rotation.",
            f"  tcp: {{offset: {_list(tcp.position)}{turn}}}",
        ]
    text = "\n".join(lines) + "\n"
    parse_scene(text, output.absolute())
    with file_system.whole([output], output) as (beside,):
        beside.write_text(text, encoding="utf-8")


def _uncalibrated_hand_cameras(
    scene: SceneDescription, found: CalibrationEstimate, shift: Pose
) -> list[tuple[str, Pose]]:
    """Return cameras on the hand that were calibrated before and not now, with their poses. They keep their
    place on the hand when the TCP is corrected."""
    if scene.calibration is None or shift == Pose():
        return []
    now = {camera.name for camera in found.cameras}
    before = scene.calibration.cameras
    return [
        (c.name, shift.inverse() @ c.pose)
        for c in scene.cameras
        if c.on == "hand" and c.name in before and c.name not in now
    ]


def _named(path: Path, shipped: Path, output: Path) -> str:
    """Return a file's name as a file next to `output` refers to it."""
    if path.parent == shipped:
        return path.stem
    beside = relpath(path.resolve(), output.resolve().parent)
    return beside if "/" in beside or beside.endswith((".yaml", ".yml")) else f"./{beside}"


def _deviation_comment(camera: CameraEstimate) -> str:
    position = ", ".join(f"{1000 * s:.3f}" for s in camera.deviation.position)
    angle = ", ".join(f"{math.degrees(s):.4f}" for s in camera.deviation.angle)
    frame = "TCP" if camera.on_hand else "world"
    return f"± {position} mm and ± {angle}° along and about the {frame}'s x, y, z."


def _pose_text(pose: Pose) -> str:
    return f"{{at: {_list(pose.position)}, rpy: {_list(pose.rpy())}}}"


def _list(numbers: Vector3) -> str:
    return "[" + ", ".join(f"{n:.{DECIMAL_DIGITS}f}" for n in numbers) + "]"


MAX_SHOWN_SKIPS = 4
"""Greatest number of skipped views and touches in the text."""


@dataclass(frozen=True, slots=True)
class CalibrationAnswer:
    """Answer of `picktree calibrate`; m, rad."""

    scene: str
    seed: int
    status: RunStatus
    folder: Path
    skipped: tuple[str, ...] = ()
    """Skipped views and touches, with reasons."""
    unseen: tuple[str, ...] = ()
    """Cameras that did not see the target."""
    known: CalibrationEstimate | None = None
    target_off: tuple[float, float] = (0.0, 0.0)
    """Distance and rotation of the target from its believed pose, m, rad."""
    output: Path | None = None
    """Corrected scene file; None: no file was written."""
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
                f"target      was {1000 * off:.1f} mm and {math.degrees(turned):.2f}° from its believed pose"
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
        f"its pose is now known to ± {1000 * sigma:.2f} mm, ± {math.degrees(angle):.2f}°",
        f"            from {views}; residual {camera.pixels:.2f} px, {1000 * camera.depth:.2f} mm of depth",
    ]


def _tool_lines(tool: ToolEstimate) -> list[str]:
    sigma = ", ".join(f"{1000 * s:.2f}" for s in tool.deviation)
    if not tool.sure:
        return [f"tool        not changed: {tool.touches} touches determine it to ± {sigma} mm only"]
    x, y, z = (1000 * c for c in tool.offset)
    return [
        f"tool        was off by x {x:+.2f}, y {y:+.2f}, z {z:+.2f} mm; its position is now known "
        f"to ± {sigma} mm",
        f"            from {tool.touches} touches; residual {1000 * tool.left:.2f} mm; "
        "touching does not measure the tool's rotation",
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
    robot_at: str = ""
    """Address of the robot's process; empty: a simulation. The target is where the scene has it, or `place`
    says."""
    speed: float = 1.0
    """Share of the joints' speeds that a robot may use."""


def calibrate(request: CalibrationRequest, observers: Sequence[Observer] = ()) -> CalibrationAnswer:
    """Run the calibration and write the corrected scene.

    Raises PicktreeError for an unknown scene, robot, camera or target, and when the file must not be replaced
    or cannot be written. An answer without a file gives the reason.
    """
    output = output_file(request.scene, request.output, replace=request.replace)
    scene = calibration_scene(request.scene, request.place)
    target = _target(scene, request.target)
    cameras = _cameras(scene, request.cameras)
    if not cameras and not request.touch:
        raise PicktreeError(f"{request.scene} has no camera: with --no-tcp there is nothing to calibrate")
    beside = Path.cwd() if request.robot else Path(scene.source).parent
    robot = load_robot(request.robot or scene.robot, beside)
    text = mission_text(
        target.name, cameras, request.views, touch=request.touch, all_of_them=not request.cameras
    )
    mission = parse_mission(text, Path("calibrate.yaml"), NodeRegistry())
    recipe = run_recipe.Recipe(
        mission, scene, robot, request.seed, robot_at=request.robot_at, speed=request.speed
    )
    result = Session(recipe, record=run_recipe.Recording(request.out), observers=observers).run()
    found = _record(result)
    answer = CalibrationAnswer(request.scene, request.seed, result.status, result.folder, found.skipped)
    if result.status != "success":
        return replace(answer, why_not=result.message or f"the run ended as {result.status}")
    evidence = observations.CalibrationData(
        found.shots, found.touches, calibration_targets.fingertip_corners(RobotModel(robot))
    )
    seen = {shot.camera for shot in found.shots}
    answer = replace(answer, unseen=tuple(camera for camera in cameras if camera not in seen))
    try:
        known = estimate(evidence, target.tiles, target.size, target.pose)
    except PicktreeError as error:
        return replace(answer, why_not=str(error))
    when = datetime.now().strftime("%Y-%m-%d %H:%M")
    write(
        output, request.scene, request.robot, scene, known, when, f"picktree calibrate, {result.folder.name}"
    )
    target_off = known.target.distance(target.pose), known.target.angle(target.pose)
    return replace(answer, known=known, target_off=target_off, output=output)


def mission_text(target: str, cameras: Sequence[str], views: int, *, touch: bool, all_of_them: bool) -> str:
    """Return the mission of looks and touches. Without `all_of_them` any camera may miss the target."""
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


def _target(scene: SceneDescription, name: str | None) -> calibration_targets.CalibrationTarget:
    known = calibration_targets.targets(scene.fixtures)
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
    shots: tuple[observations.TargetImage, ...]
    touches: tuple[observations.TargetTouch, ...]
    skipped: tuple[str, ...]


def _record(result: RunResult) -> _Recorded:
    """Return the observations of the target in the run's log. The estimate uses the log alone."""
    shots: list[observations.TargetImage] = []
    touches: list[observations.TargetTouch] = []
    skipped: list[str] = []
    with RunLog(result.log) as log:
        for at in log.events():
            match at.record:
                case event_types.CalibrationShotEvent() as event:
                    shots.append(observations.TargetImage.from_event(event))
                case event_types.CalibrationTouchEvent() as event:
                    touches.append(observations.TargetTouch.from_event(event))
                case event_types.CalibrationSkippedEvent(message=message):
                    skipped.append(message)
                case _:
                    pass
    return _Recorded(tuple(shots), tuple(touches), tuple(skipped))
