"""The panels besides the 3-D one: lanes of statuses, plots, raw messages, images, lines for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ....logs.schema import topics
from ...run import Run
from .lanes import lanes
from .layout_format import Image, Log, Plot, RawMessages, Series, StateTransitions, Transition
from .message_path import literal

_EVENTS = ("fault", "pick", "recovery", "item_done", "safety_stop", "mission_edited")
"""Kinds of event that have a lane, where the log holds any."""


def state_transitions(run: Run) -> StateTransitions:
    """A lane for the root, for the nodes that matter, and for each kind of event that happened."""
    paths = [_transition("root status", f"{topics.TICK.name}.root_status")]
    for lane in lanes(run):
        name = literal(lane.path)
        if name is not None:
            paths.append(_transition(lane.label, f"{topics.TICK.name}.nodes[:]{{path=={name}}}.status"))
    happened = {at.record.kind for at in run.events}
    paths += [
        _transition(kind.replace("_", " "), f'{topics.EVENTS.name}{{kind=="{kind}"}}.message')
        for kind in _EVENTS
        if kind in happened
    ]
    return {"isSynced": True, "paths": paths, "foxglovePanelTitle": "Tree"}


def plots(run: Run) -> tuple[Plot, ...]:
    """Wrench, positions, velocities, tracking error, gripper and wall time: of what the log holds."""
    held = {name for name, info in run.log.topics.items() if info.messages}
    made: list[Plot] = []
    if topics.WRENCH.name in held:
        force = [(f"f{axis} (N)", f"{topics.WRENCH.name}.force.{axis}") for axis in "xyz"]
        torque = [(f"t{axis} (Nm)", f"{topics.WRENCH.name}.torque.{axis}") for axis in "xyz"]
        made.append(_plot("Wrench", [*force, *torque, ("|f| (N)", f"{topics.WRENCH.name}.magnitude")]))
    arm, fingers = _joints(run)
    if arm:
        made.append(_plot("Joints (rad)", _of_joints(arm, "position")))
        made.append(_plot("Velocity (rad/s)", _of_joints(arm, "velocity")))
    if topics.CONTROL.name in held:
        errors = [(name, f"{topics.CONTROL.name}.error[{k}]") for k, name in enumerate(arm)]
        made.append(_plot("Tracking error (rad)", errors))
    if fingers:
        finger = fingers[:1]
        opening = [(f"{name} (m)", path) for name, path in _of_joints(finger, "position")]
        load = [(f"{name} (N)", path) for name, path in _of_joints(finger, "effort")]
        made.append(_plot("Gripper: half of the opening", opening))
        made.append(_plot("Grip force", load))
    if topics.TIMING.name in held:
        parts = ("total", "physics", "control", "planning", "perception", "recording")
        made.append(_plot("Wall time (s)", [(part, f"{topics.TIMING.name}.{part}") for part in parts]))
    return tuple(made)


def running_nodes() -> RawMessages:
    return _raw("Running nodes", f'{topics.TICK.name}.nodes[:]{{status=="RUNNING"}}')


def raw_messages(run: Run) -> tuple[RawMessages, ...]:
    """Of events, plans, candidates and what was written to the blackboard: of what the log holds."""
    held = {name for name, info in run.log.topics.items() if info.messages}
    wanted = (
        ("Failing nodes", topics.TICK.name, '.nodes[:]{status=="FAILURE"}'),
        ("Blackboard writes", topics.TICK.name, ".writes"),
        ("Events", topics.EVENTS.name, ""),
        ("Plans", topics.PLAN.name, ""),
        ("Candidates", topics.CANDIDATES.name, ""),
    )
    return tuple(_raw(title, topic + rest) for title, topic, rest in wanted if topic in held)


def images(run: Run) -> tuple[Image, ...]:
    """Colour and depth of each camera."""
    return tuple(
        {
            "imageMode": {
                "imageTopic": topic.name,
                "calibrationTopic": topics.calibration_topic(camera).name,
            },
            "foxglovePanelTitle": f"{camera}, {what}",
        }
        for camera in run.log.cameras
        for what, topic in (("colour", topics.colour_topic(camera)), ("depth", topics.depth_topic(camera)))
    )


def log() -> Log:
    return {
        "searchTerms": [],
        "minLogLevel": 1,
        "topicToRender": topics.LOG.name,
        "foxglovePanelTitle": "Failures and recoveries",
    }


def _joints(run: Run) -> tuple[Sequence[str], Sequence[str]]:
    """Names of the arm's joints and of the fingers', as the log has them: a waypoint of a plan has as many
    values as the arm has joints. All are the arm's when nothing was planned."""
    first = next(run.log.joints(), None)
    if first is None:
        return (), ()
    names = first.record.names
    arm = next((len(at.record.path[0]) for at in run.plans if at.record.path), len(names))
    return names[:arm], names[arm:]


def _of_joints(names: Iterable[str], quantity: str) -> list[tuple[str, str]]:
    return [
        (name, f"{topics.JOINTS.name}.joints[:]{{name=={quoted}}}.{quantity}")
        for name in names
        if (quoted := literal(name)) is not None
    ]


def _transition(label: str, value: str) -> Transition:
    return {"value": value, "label": label, "timestampMethod": "receiveTime"}


def _plot(title: str, paths: Sequence[tuple[str, str]]) -> Plot:
    series: list[Series] = [
        {"value": value, "label": label, "enabled": True, "timestampMethod": "receiveTime"}
        for label, value in paths
    ]
    return {
        "paths": series,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "left",
        "showPlotValuesInLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 200,
        "foxglovePanelTitle": title,
    }


def _raw(title: str, path: str) -> RawMessages:
    return {
        "topicPath": path,
        "diffMethod": "custom",
        "diffTopicPath": "",
        "showFullMessageForDiff": False,
        "diffEnabled": False,
        "foxglovePanelTitle": title,
    }
