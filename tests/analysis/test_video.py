"""Films: decoded again, they have the length, the size and the contents that were asked for."""

import sys
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from picktree.analysis.render import FilmRequest, PictureView, film
from picktree.analysis.render.films import FrameSetup, FrameWorkers
from picktree.analysis.render.frames import FrameContent, moments
from picktree.analysis.render.scene_view import Show
from picktree.files import PicktreeError
from picktree.logs import RunLog, RunResult, install_command
from picktree.session import RunRequest, Session

SMALL = (256, 160)


def decoded(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(video=0)]


def red(picture: np.ndarray) -> int:
    return int(((picture[:, :, 0] > 150) & (picture[:, :, 1] < 90) & (picture[:, :, 2] < 90)).sum())


def test_an_mp4_is_h264_that_browsers_play(picked: RunResult, tmp_path: Path) -> None:
    output = tmp_path / "new" / "film.mp4"
    with RunLog(picked.log) as log:
        made = film(log, output, FilmRequest(start=1.0, end=3.0, speed=2.0, fps=20, size=SMALL))
    assert (made.frames, made.seconds, made.size) == (20, 1.0, SMALL)
    assert made.bytes == output.stat().st_size
    with av.open(str(output)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height, stream.frames, stream.average_rate) == (*SMALL, 20, 20)
    assert len(decoded(output)) == 20
    assert output.read_bytes().index(b"moov") < 100  # plays before all of it has arrived
    assert [path.name for path in output.parent.iterdir()] == ["film.mp4"]


def test_the_robot_moves_and_the_line_at_the_foot_goes_on(picked: RunResult, tmp_path: Path) -> None:
    with RunLog(picked.log) as log:
        film(log, tmp_path / "film.mp4", FilmRequest(start=0.3, end=1.3, fps=12, size=SMALL))
    frames = decoded(tmp_path / "film.mp4")
    assert len(frames) == 12
    for before, after in pairwise(frames):
        moved = np.abs(after[:140] - before[:140]).max(axis=2) > 60
        assert 20 < moved.sum() < 0.3 * moved.size
    assert all((frame[148:158, 8:30].sum(axis=2) < 300).any() for frame in frames)  # the time in dark ink
    passed = [int((frame[-1, :, 2] > frame[-1, :, 0] + 80).sum()) for frame in frames]
    assert passed == sorted(passed) and passed[-1] > passed[0] + 180


def test_a_failure_stands_in_the_film_for_a_while(log_path: Path, tmp_path: Path) -> None:
    with RunLog(log_path) as log:  # its node fails at 1.5 s
        film(log, tmp_path / "film.mp4", FilmRequest(start=1.0, end=2.9, speed=0.5, fps=10, size=SMALL))
    shown = [red(frame[100:146]) > 400 for frame in decoded(tmp_path / "film.mp4")]
    assert shown == [False] * 10 + [True] * 20 + [False] * 8


def test_a_gif_has_the_same_frames(picked: RunResult, tmp_path: Path) -> None:
    with RunLog(picked.log) as log:
        made = film(log, tmp_path / "film.gif", FilmRequest(start=1.0, end=2.0, size=SMALL))
        film(log, tmp_path / "film.mp4", FilmRequest(start=1.0, end=2.0, size=SMALL, fps=10))
    assert (made.frames, made.fps) == (10, 10)
    some, others = decoded(tmp_path / "film.gif"), decoded(tmp_path / "film.mp4")
    assert len(some) == 10
    for a, b in zip(some, others, strict=True):
        assert np.abs(a - b).mean() < 4
    assert made.bytes < 250_000


def test_several_processes_draw_the_same_in_the_same_order(picked: RunResult) -> None:
    with RunLog(picked.log) as log:
        setup = FrameSetup(log.robot_model(), PictureView(), SMALL, {})
        frames = list(moments(log, [0.5, 1.0, 1.5, 2.0, 2.5], (0.0, 3.0)))
    with FrameWorkers(setup, 2) as two:
        drawn = list(two.pictures(frames))
    with FrameWorkers(setup, 1) as one:
        for a, b in zip(drawn, one.pictures(frames), strict=True):
            assert (np.abs(a.astype(int) - b) > 2).mean() < 0.001
    assert np.abs(drawn[0].astype(int) - drawn[-1]).max() > 100


def test_belief_truth_or_both_are_shown_and_told(picked: RunResult) -> None:
    with RunLog(picked.log) as log:

        def first(show: Show, speed: float) -> FrameContent:
            return next(moments(log, [0.0], (0.0, 0.0), show=show, speed=speed))

        believed, true, both = first("belief", 1.0), first("truth", 0.5), first("both", 4.0)
    notes = [each.caption.note for each in (believed, true, both)]
    assert notes == ["", "truth · 0.5×", "outlines: truth · 4×"]
    assert believed.shown.solid.bodies == () and believed.shown.outlined is None  # nothing was seen yet
    assert len(true.shown.solid.bodies) > 0
    assert true.shown.solid.fixed == believed.shown.solid.fixed == both.shown.solid.fixed
    assert both.shown.solid == believed.shown.solid and both.shown.outlined is not None
    assert both.shown.outlined.bodies == true.shown.solid.bodies


def test_the_planned_path_is_shown_while_it_is_followed(picked: RunResult) -> None:
    with RunLog(picked.log) as log:
        plan = next(at for at in log.plans() if at.record.tool_path)
        end = plan.time + plan.record.thinking + plan.record.duration
        ahead = [at for at in log.plans() if at.record.tool_path][1]
        later = [end + 0.05 * k for k in range(40)]  # the fingers close in between
        times = [plan.time - 0.01, (plan.time + end) / 2, *later]
        before, amid, *after = moments(log, times, (0.0, log.end))
    assert before.shown.path == ()
    assert amid.shown.path == plan.record.tool_path
    assert ahead.record.tool_path in [moment.shown.path for moment in after]


def test_what_runs_and_how_much_is_done_is_said(picked: RunResult) -> None:
    with RunLog(picked.log) as log:
        said = [
            (caption.node, caption.message, caption.done)
            for caption in (frame.caption for frame in moments(log, [1.0, log.end], (0.0, log.end)))
        ]
    assert said[0] == ("Grasp", "blue_plate_1 · approach", "0 of 4 items done")
    assert said[1] == ("SUCCESS", "", "1 of 4 items done")


def caption_at_the_end(log: Path) -> str:
    with RunLog(log) as opened:
        return next(moments(opened, [opened.end], (0.0, opened.end))).caption.done


def test_how_much_is_done_is_said_of_a_run_in_parts(in_parts: tuple[Path, Path], tmp_path: Path) -> None:
    """A later file does not know what was done before it, and a resumed run does."""
    folder, resumed = in_parts
    assert caption_at_the_end(folder / "log.mcap") == "4 of 12 items done"
    assert caption_at_the_end(folder / "log-0002.mcap") == "1 item done since 8.9 s"
    assert caption_at_the_end(resumed) == "6 of 12 items done"
    with RunLog(resumed) as log:
        assert log.run.continues is not None and log.run.continues.items_done == 4
        request = FilmRequest(end=log.run.continues.time + 0.5, size=SMALL)
        assert film(log, tmp_path / "film.gif", request).seconds == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("name", "request_", "said"),
    [
        ("film.avi", FilmRequest(), "{file}: a film is a file that ends in .mp4 or .gif"),
        ("film.mp4", FilmRequest(start=2.0, end=2.0), "from 2 s to 2 s there is nothing to film"),
        ("film.mp4", FilmRequest(start=50.0), "{log}: the run lasted 2.95 s; there is nothing from 50 s on"),
        ("film.mp4", FilmRequest(speed=0.0), "speed 0: it must be more than 0"),
        ("film.mp4", FilmRequest(size=(321, 200)), "size 321x200: the sides of an MP4 must be even"),
        ("file/film.mp4", FilmRequest(), "{file} cannot be written: file exists"),
    ],
)
def test_what_cannot_be_filmed_is_refused(
    log_path: Path, tmp_path: Path, name: str, request_: FilmRequest, said: str
) -> None:
    (tmp_path / "file").touch()
    with RunLog(log_path) as log, pytest.raises(PicktreeError) as raised:
        film(log, tmp_path / name, request_)
    assert str(raised.value) == said.format(file=tmp_path / name, log=log_path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_without_the_extra_it_is_said_how_to_get_it(
    log_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with RunLog(log_path) as log, pytest.raises(PicktreeError) as raised:
        film(log, tmp_path / "film.mp4")
    assert str(raised.value) == f"A video needs the extra 'video': {install_command('video')}"


def test_an_interrupted_film_leaves_no_file(log_path: Path, tmp_path: Path) -> None:
    def interrupt(done: int, count: int) -> None:
        assert count == 59
        if done == 3:
            raise KeyboardInterrupt

    with RunLog(log_path) as log, pytest.raises(KeyboardInterrupt):
        film(log, tmp_path / "film.mp4", FilmRequest(size=SMALL), interrupt)
    assert list(tmp_path.iterdir()) == []


def test_true_items_move_more_often_than_they_are_looked_at(tmp_path: Path) -> None:
    mission = Path(__file__).parents[1] / "golden" / "one_item.yaml"
    with RunLog(Session(RunRequest(mission, out=tmp_path)).run().log) as log:
        looks = sum(1 for _ in log.truths())
        times = np.arange(0.0, log.end, 0.1).tolist()
        frames = list(moments(log, times, (0.0, log.end), show="truth"))
    places = [[body.pose for body in frame.shown.solid.bodies] for frame in frames]
    assert sum(before != after for before, after in pairwise(places)) > looks
    assert all(frame.shown.solid.fixed for frame in frames)
