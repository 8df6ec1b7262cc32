"""Format of the layout file of Lichtblick and of Foxglove Studio, as far as picktree writes it.

Names and types are theirs: `packages/suite-base/src/panels/*/types.ts` of Lichtblick 1.28.
"""

from __future__ import annotations

from typing import Literal, NotRequired, TypedDict


class CameraState(TypedDict):
    """Camera of a 3-D panel; degrees and m. It orbits `targetOffset`; the file keeps `target`, but viewers
    ignore it."""

    distance: float
    perspective: bool
    phi: float
    """Angle from the vertical, degrees."""
    target: list[float]
    targetOffset: list[float]
    targetOrientation: list[float]
    thetaOffset: float
    fovy: float
    near: float
    far: float


class Grid(TypedDict):
    layerId: Literal["foxglove.Grid"]
    instanceId: str
    label: str
    visible: bool
    frameLocked: bool
    frameId: str
    size: float
    divisions: int
    lineWidth: float
    color: str
    position: list[float]
    rotation: list[float]


class Entities(TypedDict):
    """Display of a topic of scene updates."""

    visible: bool
    color: NotRequired[str]
    """Colour with alpha, in place of the entities' own."""
    showOutlines: NotRequired[bool]


class Frustum(TypedDict):
    """Display of a topic of camera calibrations."""

    visible: bool
    color: str
    distance: float
    """Length of the frustum, m."""


class TopicVisibility(TypedDict):
    visible: bool


class FrameAxes(TypedDict):
    axisScale: float
    showLabel: bool


class ThreeDeeScene(TypedDict):
    syncCamera: bool
    transforms: FrameAxes


class ThreeDee(TypedDict):
    cameraState: CameraState
    followMode: Literal["follow-none"]
    followTf: str
    scene: ThreeDeeScene
    transforms: dict[str, TopicVisibility]
    """Visibility of frames, by `frame:NAME`."""
    topics: dict[str, Entities | Frustum]
    layers: dict[str, Grid]
    foxglovePanelTitle: str


class StateSeries(TypedDict):
    value: str
    label: str
    timestampMethod: Literal["receiveTime"]


class StateTransitions(TypedDict):
    isSynced: bool
    paths: list[StateSeries]
    foxglovePanelTitle: str


class Series(TypedDict):
    value: str
    label: str
    enabled: bool
    timestampMethod: Literal["receiveTime"]


class PlotPanel(TypedDict):
    paths: list[Series]
    showXAxisLabels: bool
    showYAxisLabels: bool
    showLegend: bool
    legendDisplay: Literal["floating", "left"]
    showPlotValuesInLegend: bool
    isSynced: bool
    xAxisVal: Literal["timestamp"]
    sidebarDimension: int
    foxglovePanelTitle: str


class RawMessages(TypedDict):
    topicPath: str
    diffMethod: Literal["custom", "previous message"]
    diffTopicPath: str
    showFullMessageForDiff: bool
    diffEnabled: bool
    foxglovePanelTitle: str


class LogPanel(TypedDict):
    searchTerms: list[str]
    minLogLevel: int
    topicToRender: str
    foxglovePanelTitle: str


class ImageMode(TypedDict):
    imageTopic: str
    calibrationTopic: str


class Image(TypedDict):
    imageMode: ImageMode
    foxglovePanelTitle: str


class Split(TypedDict):
    direction: Literal["row", "column"]
    first: str | Split
    second: str | Split
    splitPercentage: float


class TabEntry(TypedDict):
    title: str
    layout: str | Split


class Tab(TypedDict):
    activeTabIdx: int
    tabs: list[TabEntry]


class Playback(TypedDict):
    speed: float


Panel = ThreeDee | StateTransitions | PlotPanel | RawMessages | LogPanel | Image | Tab


class LayoutFile(TypedDict):
    configById: dict[str, Panel]
    """Panels by `TYPE!NAME`."""
    globalVariables: dict[str, str]
    userNodes: dict[str, str]
    playbackConfig: Playback
    layout: str | Split
