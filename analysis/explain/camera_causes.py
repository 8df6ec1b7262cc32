"""Causes in cameras: no image, an old, noisy or shifted one, wrong colours; and an arm that hides items."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from picktree.files import listed
from picktree.logs import CameraImage, Stamped
from picktree.robot.perception import BackgroundModel, PosedCamera, depth_noise, noise_factor, table_of
from picktree.world import Array, extents

from .case import ARM_RANGE, Investigation
from .explanation import Finding, Spans, number, word
from .identities import MAX_AGE, Sighting
from .wording import between, counted, distance, listed_spans, listed_times, place, seconds


def camera_silent(case: Investigation) -> Iterator[Finding]:
    """Find a camera that returns no image, the same image again, or an image that is too noisy."""
    for failure in case.failures:
        if failure.cause != "perception.no_image":
            continue
        name = word(failure, "camera") or case.camera
        start = case.visit(failure).start
        cause, title = "camera.silent", f"no image came from the camera {name}, from {seconds(start)} on"
        if (still := number(failure, "frozen")) is not None:
            start = max(failure.time - still, 0.0)
            cause, title = "camera.frozen", _stands_still(name, start)
        elif (factor := number(failure, "noise")) is not None:
            cause, title = "camera.noisy", _is_noisy(name, factor)
        span = (start, failure.time)
        yield Finding(cause, name, title, (failure.message,), "", start, spans=(span,))


def _stands_still(camera: str, start: float) -> str:
    return f"the image of the camera {camera} was frozen, from {seconds(start)} on"


def _is_noisy(name: str, factor: float) -> str:
    return f"the camera {name} is {factor:.0f} times as noisy as it should be"


MAX_IMAGES = 24
"""Maximum number of examined images of a run."""


def looks(case: Investigation) -> tuple[Stamped[CameraImage], ...]:
    """Return images of the fixed cameras, spread over the run."""
    shots = case.run.images
    fixed = {camera.name for camera in case.fixed_cameras}
    theirs = [n for n, camera in enumerate(shots.cameras) if camera in fixed]
    chosen = sorted({int(n) for n in np.linspace(0, len(theirs) - 1, min(len(theirs), MAX_IMAGES))})
    return tuple(shots[theirs[n]] for n in chosen)


MIN_HEIGHT = 0.1
"""Height above an item's top from which a body in the image hides the item, m."""


def explain_hidden_by_arm(case: Investigation, true: str) -> Finding | None:
    """Return the finding that the arm hid an item from the fixed cameras in all images of its place."""
    found: list[tuple[Stamped[CameraImage], float]] = []
    for shot in case.once(looks):
        body, image = case.bodies.at(true, shot.time), shot.record
        if body is None:
            continue
        sight = PosedCamera.at(image.intrinsics, case.cameras[image.camera].pose)
        top = np.array(body.pose.position)
        top[2] += extents(body.shape, body.pose.rotation())[1][2]
        ((column, row),) = pixels = np.rint(sight.pixels(top[None])).astype(np.int64)
        if not (0 <= column < image.intrinsics.width and 0 <= row < image.intrinsics.height):
            continue
        depth = float(image.depth[row, column])
        shown = sight.origin + sight.directions(pixels.astype(np.float64))[0] * depth
        links = case.links(shot.time)
        arm = len(links) > 0 and float(np.linalg.norm(links - shown, axis=1).min()) < ARM_RANGE
        if depth <= 0.0 or shown[2] < top[2] + MIN_HEIGHT or not arm:
            return None
        found.append((shot, float(shown[2] - top[2])))
    if not found:
        return None
    shot, height = found[0]
    camera, item = shot.record.camera, case.name_of(true)
    title = f"the arm hides items on the table from the camera {camera}"
    lies = f"{item} lies at {place(case.bodies.tracks[true].first.pose.position)}"
    shows = f"the image of {seconds(shot.time)} shows the arm there, {distance(height)} above it"
    home = f"'home' under 'poses:' in the robot file of {case.run.info.robot}"
    reasons = (
        f"{lies}: {shows}",
        f"{counted(len(found), 'image')} of its place, but none shows the item",
        f"what to change: the arm's pose during the look, mostly {home}; "
        "`picktree robot test` measures what the arm hides",
    )
    return Finding("arm.hides_items", camera, title, reasons, item, shot.time)


LEAST_NOISE = 5e-4
"""Noise of a depth image above which no two logged images are equal, m: the log has steps of 1 mm."""
IMAGE_DELAY = 0.5
"""Time after its capture within which an image is in the log, s."""
MIN_SHIFT = 0.02
"""Least displacement of an item that changes an image, m."""


def camera_frozen(case: Investigation) -> Iterator[Finding]:
    """Find a frozen camera: it repeats an image despite its noise, or despite moved items."""
    shots: dict[str, list[Stamped[CameraImage]]] = defaultdict(list)
    for shot in case.once(looks):
        shots[shot.record.camera].append(shot)
    for name, taken in shots.items():
        same = [(a, b) for a, b in pairwise(taken) if np.array_equal(a.record.depth, b.record.depth)]
        noisy = [(a, b) for a, b in same if depth_noise(a.record.depth)[0] > LEAST_NOISE]
        shown = next((a.time for a, b in same if _shifted(case, a.time, b.time)), math.inf)
        frozen = noisy or [pair for pair in same if pair[0].time >= shown]
        if frozen:
            start, end = frozen[0][0].time, frozen[-1][1].time
            why = "and the camera has noise" if noisy else "though items were moved"
            reasons = (f"its images of {seconds(start)} and {seconds(end)} are the same, {why}",)
            title, looked = _stands_still(name, start), [shot.time for shot in taken]
            spans = _runs([shot.time for pair in frozen for shot in pair], looked)
            yield Finding("camera.frozen", name, title, reasons, "", start, spans=spans)


def _shifted(case: Investigation, start: float, end: float) -> bool:
    """Whether an item of one image was truly at another place at the time of the next image."""
    shown = {each.true for each in case.identities.sightings if -IMAGE_DELAY <= each.time - start < MAX_AGE}
    moved = ((case.bodies.at(true, start), case.bodies.at(true, end)) for true in shown - {""})
    return any(a and (not b or math.dist(a.pose.position, b.pose.position) > MIN_SHIFT) for a, b in moved)


def camera_noisy(case: Investigation) -> Iterator[Finding]:
    """Find a noisy camera: its depth images scatter far more than its specified noise."""
    found: dict[str, dict[float, float]] = defaultdict(dict)
    for shot in case.once(looks):
        name = shot.record.camera
        if factor := noise_factor(shot.record.depth, case.cameras[name].depth_noise):
            found[name][shot.time] = factor
    for name, factors in found.items():
        times = list(factors)
        noisy = f"{counted(len(times), 'image')}, {listed_spans((time, time) for time in times)}"
        reasons = (f"its depth was as noisy as this in {noisy}",)
        runs = _runs(times, sorted(case.run.images.times))
        title = _is_noisy(name, max(factors.values()))
        yield Finding("camera.noisy", name, title, reasons, "", times[0], spans=runs)


def displaced_cameras(case: Investigation) -> tuple[Finding, ...]:
    """Return the findings about cameras whose images show bins and fixtures beside their places."""
    return tuple(_displaced(case))


MIN_OFFSET = 0.006
"""Offset of an item's believed place from its true one above which a camera may be the cause, m."""


def _displaced(case: Investigation) -> Iterator[Finding]:
    scene = case.scene
    if scene is None:
        return
    table = table_of(scene)
    expected: dict[str, tuple[Array, float]] = {}
    found: dict[str, list[tuple[float, tuple[float, float]]]] = defaultdict(list)
    times: dict[str, list[float]] = defaultdict(list)
    for shot in case.once(looks):
        image, name = shot.record, shot.record.camera
        if name not in expected:
            sight = PosedCamera.at(image.intrinsics, case.cameras[name].pose)
            top = 0.0 if table is None else table.pose.position[2] + extents(table.shape, np.eye(3))[1][2]
            expected[name] = BackgroundModel.of(scene, sight, table, top).depth, image.intrinsics.fx
        times[name].append(shot.time)
        if (shift := background_shift(image.depth.astype(np.float64), *expected[name])) is not None:
            found[name].append((shot.time, shift))
    for name, shifts in found.items():
        ways = np.array([shift for _, shift in shifts])
        across, down = np.median(ways, axis=0)
        size, start = math.hypot(across, down), shifts[0][0]
        away = f"{distance(size)} from its believed pose"
        title = f"the camera {name} is {away}: every object is believed at a wrong place"
        shift = f"{distance(abs(float(across)))} across and {distance(abs(float(down)))} down"
        shown = f"bins and fixtures appear {shift} in its image from where the scene has them"
        reasons = (f"{shown}, at {listed_times([time for time, _ in shifts])}",)
        spans = _runs([time for time, _ in shifts], sorted(times[name]))
        yield Finding("camera.off", f"the camera {name}", title, reasons, "", start, spans=spans)


MAX_PIXELS = 20
"""Greatest shift of the image that is looked for, pixels."""
MIN_PIXELS = 1.5
"""Least shift that counts as a displacement, pixels."""
EDGE_STEP = 0.01
"""Step of the expected depth that makes an edge, m."""
MAX_DEPTH_ERROR = 0.05
"""Error of a pixel's depth above which it counts no more: something hides the edge, m."""
MAX_COST_SHARE = 0.6
"""Share of the error at the believed pose below which another pose is the true one."""
MAX_EDGE_PIXELS = 3000
"""Number of pixels at edges that are compared."""


def background_shift(depth: Array, expected: Array, focal: float) -> tuple[float, float] | None:
    """Return the shift between a depth image and the expected one of the empty scene (h, w): right and down
    at the edges' depth, m. None without a clear shift."""
    model = np.where(np.isfinite(expected), expected, 0.0)
    across = np.abs(np.diff(model, axis=1, prepend=model[:, :1]))
    edge = np.maximum(across, np.abs(np.diff(model, axis=0, prepend=model[:1]))) > EDGE_STEP
    near = edge.copy()
    for by in (-2, -1, 1, 2):
        near |= np.roll(edge, by, 0) | np.roll(edge, by, 1)
    inside = np.zeros_like(near)
    inside[MAX_PIXELS:-MAX_PIXELS, MAX_PIXELS:-MAX_PIXELS] = True
    rows, columns = np.nonzero(near & inside & (model > 0.0))
    every = max(1, len(rows) // MAX_EDGE_PIXELS)
    rows, columns = rows[::every], columns[::every]
    wanted = model[rows, columns]
    if len(rows) < 100:
        return None

    def cost(down: int, right: int) -> float:
        shown = depth[rows + down, columns + right]
        seen = shown > 0.0
        if int(seen.sum()) < len(rows) // 2:
            return MAX_DEPTH_ERROR
        return float(np.minimum(np.abs(shown - wanted), MAX_DEPTH_ERROR)[seen].mean())

    reach = range(-MAX_PIXELS, MAX_PIXELS + 1)
    here = cost(0, 0)
    best, down, right = min((cost(v, u), v, u) for v in reach for u in reach)
    if math.hypot(down, right) < MIN_PIXELS or best > MAX_COST_SHARE * here:
        return None
    scale = float(np.median(wanted)) / focal
    return right * scale, down * scale


def explain_displaced_camera(case: Investigation, item: str, time: float) -> Finding | None:
    """Return the finding about a displaced camera whose image was the last of the item before that time."""
    seen = [each for each in case.identities.by_item.get(item, ()) if each.time <= time + 1e-6]
    if not seen or (case.world.is_true and math.hypot(*seen[-1].off) < MIN_OFFSET):
        return None
    last, found = seen[-1].time, case.once(displaced_cameras)
    return next((off for off in found if any(abs(a - last) < MAX_AGE for a, _ in off.spans)), None)


def _runs(times: Iterable[float], looks: list[float]) -> Spans:
    """Return the span from each time to the next look; the belief does not change in between."""
    return tuple((time, next((look for look in looks if look > time + 1e-6), math.inf)) for time in times)


def colours_mistaken(case: Investigation) -> Iterator[Finding]:
    """Find a camera that shows items of one colour in another."""
    wrong: dict[tuple[str, str], list[Sighting]] = defaultdict(list)
    for each in case.identities.sightings:
        if each.body is not None and each.body.colour != each.seen.colour:
            wrong[each.body.colour, each.seen.colour].append(each)
    for (colour, shown), sightings in wrong.items():
        items = list(dict.fromkeys(each.item for each in sightings))
        first, start = sightings[0].body, sightings[0].time
        assert first is not None
        was, are = ("was", "is") if len(items) == 1 else ("were", "are")
        title = f"{listed(items, 5)} {was} taken for {shown} and {are} {colour}"
        about, span = f"{colour} as {shown}", (start, sightings[-1].time)
        reasons = (f"the camera {case.camera} showed {about} {between(*span)}",)
        yield Finding("perception.mistaken", about, title, reasons, items[0], start, spans=(span,))
