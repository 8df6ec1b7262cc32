"""Recognition by another process: its answers are checked, and the run goes on without them."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from picktree.drivers import ExternalRecogniser, protocol
from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.session import RunRequest, Session
from picktree.world import Intrinsics, NotRecognised, Pose, RgbdImage, event_types
from picktree.world.scene import load_scene

from .served_cell import served, write_cell

EXAMPLES = Path(__file__).parents[2] / "examples"
LENS = Intrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
FAR = Pose((0.5, 0.0, 0.8), (1.0, 0.0, 0.0, 0.0))
PICTURE = RgbdImage(
    "overhead", np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), np.float32), 1.25, LENS, FAR
)
BLOCK = protocol.Finding(
    "block", (4, 5, 3, 2), "red", 0.9, protocol.pack_mask(np.array([[1, 1, 0], [0, 1, 1]]) > 0)
)
Answer = Callable[[protocol.Channel, protocol.Look], None]
"""What a recogniser does with a picture. It raises OSError to die."""


def says(*items: protocol.Finding) -> Answer:
    return lambda channel, look: channel.send(protocol.Findings(look.stamp, items))


def sends(data: bytes) -> Answer:
    return lambda channel, look: channel.connection.sendall(data)


def dies(channel: protocol.Channel, look: protocol.Look) -> None:
    raise OSError


@contextmanager
def recogniser(folder: Path, *answers: Answer, kinds: tuple[str, ...] = ("block", "dog")) -> Generator[str]:
    """Serve in a thread. Each answer is for one picture, in whichever connection."""
    address = protocol.Address(str(folder / "eyes.sock"))
    listener, left = address.listen(), list(answers)

    def serve() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            with connection:
                channel = protocol.Channel(connection)
                try:
                    assert isinstance(channel.receive(), protocol.Hello)
                    channel.send(protocol.RecogniserInfo("fake", "1", kinds))
                    while True:
                        look = channel.receive()
                        assert isinstance(look, protocol.Look)
                        left.pop(0)(channel, look)
                except (protocol.ProtocolError, OSError):
                    pass

    thread = Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield str(address)
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(5)


def placed(*pose: float) -> protocol.Finding:
    return replace(BLOCK, pose=pose, deviation=(0.003, 0.03))


def test_what_another_process_recognises_is_checked_before_anything_believes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each wrong answer has its reason; the next picture is asked for in a new connection."""
    monkeypatch.setattr("picktree.drivers.external_recogniser.ANSWER_TIME", 0.3)
    nan = protocol.encode(protocol.Findings(1.25, (placed(0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0),)))
    nan = nan.replace(struct.pack("<d", 0.8), struct.pack("<d", float("nan")))
    wrong: list[tuple[Answer, str]] = [
        (dies, "the peer has closed the connection"),
        (lambda channel, look: None, "the peer does not answer"),
        (sends(nan), "a number is not finite"),
        (sends(b"HTTP/1.1 200"), "the peer does not speak this protocol: its frame begins with b'HTTP'"),
        (says(replace(BLOCK, kind="cat")), "it finds a 'cat', which it has not named among its kinds"),
        (
            says(placed(0.9, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0)),
            "the block is at x 0.900, y 0.000, z 0.800 m, which is not in its box of pixels",
        ),
        (
            says(placed(0.0, 0.0, -0.8, 0.0, 0.0, 0.0, 1.0)),
            "the block is at x 0.000, y 0.000, z -0.800 m, which is not in its box of pixels",
        ),
        (
            says(replace(BLOCK, box=(30, 5, 3, 2))),
            "the block is at columns 30 to 33 and rows 5 to 7 of 32 × 24 pixels",
        ),
        (
            lambda channel, look: channel.send(protocol.Findings(look.stamp - 1.0, ())),
            "it answers for a picture at 0.250 s, not at 1.250 s",
        ),
        (says(replace(BLOCK, colour="pink")), "the block has the colour 'pink'; the colours are red, "),
        (says(replace(BLOCK, confidence=1.5)), "a block has the confidence 1.5; it is 0 to 1"),
    ]
    catalogue = load_scene("sort_small", tmp_path).catalogue
    honest = says(placed(-0.2, -0.1, 0.8, 0.0, 0.0, 0.0, 1.0), replace(BLOCK, kind="dog"))
    with recogniser(tmp_path, *(answer for answer, _ in wrong), honest) as address:
        eyes = ExternalRecogniser(address, catalogue)
        assert eyes.name == "fake 1"
        for _, reason in wrong:
            with pytest.raises(NotRecognised) as raised:
                eyes.recognise(PICTURE)
            assert str(raised.value).startswith(f"the perception process at {address}: {reason}")
        (found,) = eyes.recognise(PICTURE)  # the dog is not in the catalogue
        eyes.close()
    assert (found.kind, found.colour, found.confidence, found.masked) == ("block", "red", 0.9, True)
    assert found.rows.tolist() == [5, 5, 6, 6] and found.columns.tolist() == [4, 5, 5, 6]
    assert found.pose == Pose((-0.2, -0.1, 0.8)) and (found.sigma_position, found.sigma_angle) == (
        0.003,
        0.03,
    )
    with pytest.raises(NotRecognised, match="nobody listens"):
        eyes.recognise(PICTURE)
    with pytest.raises(PicktreeError) as refused:
        ExternalRecogniser(address, catalogue)
    assert str(refused.value) == (
        f"--perception-at {address}: nobody listens (Connection refused); start its process first"
    )
    Path(address).unlink()
    with (
        recogniser(tmp_path, kinds=("dog",)) as other,
        pytest.raises(PicktreeError, match=r"it knows dog, but the scene's catalogue has ball, block"),
    ):
        ExternalRecogniser(other, catalogue)


def test_a_mission_is_run_by_what_another_process_recognises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Positions have 3 mm of noise, and each third picture stays without an answer."""
    pytest.importorskip("mujoco")
    asked = 0
    recognise = ExternalRecogniser.recognise

    def sometimes(self: ExternalRecogniser, image: RgbdImage) -> object:
        nonlocal asked
        asked += 1
        if asked % 3 == 2:
            raise NotRecognised("the perception process died")
        return recognise(self, image)

    monkeypatch.setattr(ExternalRecogniser, "recognise", sometimes)
    eyes = str(tmp_path / "eyes.sock")
    options = ("--perception-at", eyes, "--perception-noise", "0.003")
    with served(write_cell(tmp_path), *options) as cell:
        request = RunRequest(
            EXAMPLES / "sort_by_colour.yaml",
            scene="sort_small",
            out=tmp_path / "runs",
            robot_at=cell.address,
            perception_at=eyes,
            limit=90.0,
        )
        result = Session(request).run()
    assert (cell.score["sorted"], cell.score["total"], result.items.sorted) == (4, 4, 4)
    with RunLog(result.log) as log:
        assert log.run.physics["perception"] == "picktree_cell truth with noise"
        missed = [at.record for at in log.events() if isinstance(at.record, event_types.FramesMissedEvent)]
    assert missed
