"""Scene files of a calibration: the scene with a target for the run, and the corrected scene as its
result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os.path import relpath
from pathlib import Path

import yaml

from ...files.atomic_write import whole
from ...files.errors import PicktreeError
from ...files.shipped_files import find_file
from ...robot.calibration.estimate import CalibrationEstimate, CameraEstimate
from ...robot.calibration.targets import targets
from ...robot.perception.backdrop import table_of
from ...world.robot_model.loading import SHIPPED as ROBOTS
from ...world.scene.description import SceneDescription
from ...world.scene.scene_loading import SHIPPED, load_scene, parse_scene
from ...world.shapes import top
from ...world.values import Pose, Vector3
from .target_syntax import quantity

TARGET_NAME = "calibration_target"
TARGET_SIZE = (0.18, 0.16, 0.05)
"""Size of the target that is added to the scene, m."""
TARGET_YAW = math.radians(20.0)
"""Rotation of the added target about z, rad: edges along a camera's rows of pixels are measured worst."""
TARGET_UNCERTAINTY = (0.005, math.radians(2.0))
"""Uncertainty of the added target's pose, m and rad, within which a person may place it. The calibration
estimates the pose."""
DEFAULT_TARGET_DISTANCE = 0.5
"""Distance of the target in front of the origin when no area for items gives a better place, m."""


@dataclass(frozen=True, slots=True)
class TargetPlacement:
    """Place of a target, m and rad."""

    x: float
    y: float
    yaw: float = TARGET_YAW


def parse_place(text: str) -> TargetPlacement:
    """`0.5,0,20deg`: x and y, and the yaw if need be. Raises PicktreeError.

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
    path = find_file(name, SHIPPED, Path.cwd(), "scene")
    scene = load_scene(name, Path.cwd())
    own: dict[str, object] = {"picktree": 1, "kind": "scene", "base": _base(path)}
    if scene.spawn:
        own["spawn"] = None
    if scene.deliveries:
        own["feed"] = None
    if not targets(scene.fixtures):
        own["fixtures"] = {TARGET_NAME: _target(scene, place or _middle(scene))}
    beside = Path.cwd() if path.parent == SHIPPED else path.parent
    return parse_scene(yaml.safe_dump(own, sort_keys=False), beside / f"{path.stem}.yaml")


def _base(path: Path) -> str:
    return path.stem if path.parent == SHIPPED else str(path.resolve())


def _target(scene: SceneDescription, place: TargetPlacement) -> dict[str, object]:
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
        (x0, y0), (x1, y1) = load.area
        return TargetPlacement((x0 + x1) / 2, (y0 + y1) / 2)
    return TargetPlacement(DEFAULT_TARGET_DISTANCE, 0.0)


DECIMAL_DIGITS = 7
"""Digits after the decimal point: 0.1 µm, 0.1 µrad."""


def output_file(scene: str, wanted: Path | None, *, replace: bool) -> Path:
    """Return the path of the corrected scene. Raises PicktreeError where a file must not be replaced or
    cannot be written."""
    path = find_file(scene, SHIPPED, Path.cwd(), "scene")
    if wanted is None:
        here = path.parent == SHIPPED or path.parent.resolve() == Path.cwd()
        folder = Path() if here else path.parent
        wanted = folder / f"{path.stem}_calibrated.yaml"
    if wanted.suffix not in (".yaml", ".yml"):
        raise PicktreeError(f"-o {wanted}: a scene file ends in .yaml")
    if wanted.exists() and wanted.resolve() == path.resolve():
        raise PicktreeError(f"-o {wanted} is the scene itself, on which the new file is laid; name another")
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
    path = find_file(name, SHIPPED, Path.cwd(), "scene")
    tool = found.tool if found.tool is not None and found.tool.sure else None
    shift = Pose() if tool is None else Pose(tool.offset)
    lines = ["picktree: 1", "kind: scene", f"base: {_named(path, SHIPPED, output)}"]
    if robot is not None:
        lines.append(f"robot: {_named(find_file(robot, ROBOTS, Path.cwd(), 'robot'), ROBOTS, output)}")
    lines += ["", "calibration:", f"  date: {when}", f"  by: {by}"]
    kept = _uncalibrated_hand_cameras(scene, found, shift)
    if found.cameras or kept:
        lines.append("  cameras:")
    for camera in found.cameras:
        lines += [f"    # {_deviation_comment(camera)}", f"    {camera.name}: {_pose_text(camera.pose)}"]
    for camera, pose in kept:
        lines += [
            "    # As calibrated before; seen from the TCP of this time.",
            f"    {camera}: {_pose_text(pose)}",
        ]
    if tool is not None:
        tcp = scene.tool @ shift
        sigma = ", ".join(f"{1000 * s:.3f}" for s in tool.deviation)
        turn = "" if tcp.rpy() == (0.0, 0.0, 0.0) else f", rpy: {_list(tcp.rpy())}"
        lines += [
            f"  # ± {sigma} mm along x, y, z, from {tool.touches} touches; they do not tell its turn.",
            f"  tcp: {{offset: {_list(tcp.position)}{turn}}}",
        ]
    text = "\n".join(lines) + "\n"
    parse_scene(text, output.absolute())
    with whole([output], output) as (beside,):
        beside.write_text(text, encoding="utf-8")


def _uncalibrated_hand_cameras(
    scene: SceneDescription, found: CalibrationEstimate, shift: Pose
) -> list[tuple[str, Pose]]:
    """Return cameras on the hand that were calibrated before and not now, with their poses. They keep their
    place on the hand when the TCP is corrected."""
    if scene.calibration is None or shift == Pose():
        return []
    now = {camera.name for camera in found.cameras}
    before = dict(scene.calibration.cameras)
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
