"""Protocol of drivers: round trips, data that is none, addresses, and what the file may import."""

from __future__ import annotations

import ast
import os
import socket
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.drivers import protocol as p

ROOT = Path(__file__).parents[2]
numbers = st.floats(-1e6, 1e6)
micros = st.integers(0, 10**12).map(lambda n: n / 1e6)
texts = st.text(st.characters(min_codepoint=33, max_codepoint=0x2FF), max_size=30)
joints = st.integers(1, 8)


def rows(n: int, count: int) -> st.SearchStrategy[list[tuple[float, ...]]]:
    return st.lists(st.tuples(*[numbers] * n), min_size=count, max_size=count)


@st.composite
def commands(draw: st.DrawFn) -> p.Command:
    n = draw(joints)
    position, velocity, torque = draw(rows(n, 3))
    ahead = draw(rows(n, draw(st.sampled_from((0, 4)))))
    grip = draw(st.none() | st.builds(p.GripCommand, numbers, numbers, numbers))
    mode = draw(st.sampled_from(p.Mode))
    sequence = draw(st.integers(0, 2**64 - 1))
    return p.Command(
        sequence, mode, position, velocity, torque, draw(st.sampled_from((0.0, 0.005))), tuple(ahead), grip
    )


@st.composite
def states(draw: st.DrawFn) -> p.State:
    position, velocity, torque = draw(rows(draw(joints), 3))
    return p.State(
        draw(st.integers(0, 2**64 - 1)),
        draw(st.integers(0, 2**64 - 1)),
        draw(micros),
        position,
        velocity,
        torque,
        draw(st.tuples(*[numbers] * 3)),
        draw(st.tuples(*[numbers] * 6)),
        draw(st.tuples(*[micros] * 3)),
        draw(st.booleans()),
        draw(st.sampled_from(p.Stop)),
    )


@st.composite
def welcomes(draw: st.DrawFn) -> p.Welcome:
    return p.Welcome(
        draw(texts),
        draw(texts),
        p.Capability(draw(st.integers(0, 15))),
        draw(micros.filter(lambda s: s < 1000)),
        0.15,
        draw(st.tuples(*[numbers] * 6)),
        draw(numbers),
        draw(st.tuples(*[numbers] * 3)),
        tuple(draw(st.lists(st.builds(p.Joint, texts, *[numbers] * 4), min_size=1, max_size=8))),
        tuple(
            draw(
                st.lists(
                    st.builds(p.CameraInfo, texts, texts, st.just(32), st.integers(16, 64), *[numbers] * 4),
                    max_size=3,
                )
            )
        ),
        draw(st.sampled_from((0.1, 1.0))),
    )


@st.composite
def poses(draw: st.DrawFn) -> tuple[float, ...]:
    turn = np.array(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 4)) or (0.0,) * 4)
    length = float(np.linalg.norm(turn))
    unit = turn / length if length > 1e-3 else np.array([0.0, 0.0, 0.0, 1.0])
    return (*draw(st.tuples(*[numbers] * 3)), *unit.tolist())


@st.composite
def findings(draw: st.DrawFn) -> p.Finding:
    columns, rows = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    mask = draw(st.none() | st.lists(st.booleans(), min_size=columns * rows, max_size=columns * rows))
    return p.Finding(
        draw(texts),
        (draw(st.integers(0, 400)), draw(st.integers(0, 400)), columns, rows),
        draw(texts),
        draw(st.floats(0.0, 1.0)),
        b"" if mask is None else p.pack_mask(np.array(mask).reshape(rows, columns)),
        draw(st.just(()) | poses()),
        draw(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 3.0))),
    )


@st.composite
def looks(draw: st.DrawFn) -> p.Look:
    camera = p.CameraInfo(draw(texts), "", 4, 3, 5.0, 5.0, 1.5, 1.0)
    return p.Look(camera, draw(micros), draw(poses()), draw(st.binary(min_size=84, max_size=84)))


messages = st.one_of(
    st.builds(p.RecogniserInfo, texts, texts, st.lists(texts, max_size=5).map(tuple)),
    looks(),
    st.builds(p.Findings, micros, st.lists(findings(), max_size=3).map(tuple)),
    st.builds(
        p.Hello, st.sampled_from((p.Wish(0), p.Wish.SHARED_MEMORY)), texts, st.sampled_from((0.1, 1.0))
    ),
    welcomes(),
    commands(),
    states(),
    st.builds(p.Capture, st.integers(0, 255)),
    st.builds(p.Observe, micros),
    st.builds(p.Picture, st.integers(0, 255), st.booleans(), micros, st.binary(max_size=50)),
    st.builds(p.StopRequest, st.sampled_from(p.Stop)),
    st.just(p.Clear()),
    st.just(p.Bye()),
    st.builds(p.Refusal, st.sampled_from(p.Refused), texts),
)


@given(messages)
def test_a_message_comes_back_from_its_frame(message: p.Message) -> None:
    frame = p.encode(message)
    kind, length = p.decode_header(frame[:12])
    assert len(frame) == 12 + length
    assert p.decode(kind, frame[12:]) == message


@pytest.mark.parametrize("speed", [0.0, -0.1, 1.5, float("nan")])
def test_a_speed_that_is_no_share_is_refused(speed: float) -> None:
    frame = p.encode(p.Hello(p.Wish(0), "", speed))
    with pytest.raises(p.ProtocolError, match="above 0 and at most 1"):
        p.decode(p.Kind.HELLO, frame[12:])


@given(st.integers(0, 65535), st.binary(max_size=700))
def test_random_bytes_are_a_message_or_one_error(kind: int, data: bytes) -> None:
    try:
        p.decode(kind, data)
    except p.ProtocolError as error:
        assert "\n" not in str(error) and len(str(error)) < 300


@given(messages, st.data())
def test_a_damaged_frame_is_a_message_or_one_error(message: p.Message, data: st.DataObject) -> None:
    frame = bytearray(p.encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        frame[data.draw(st.integers(0, len(frame) - 1))] = data.draw(st.integers(0, 255))
    try:
        kind, _ = p.decode_header(bytes(frame[:12]))
        p.decode(kind, bytes(frame[12:]))
    except p.ProtocolError as error:
        assert "\n" not in str(error) and len(str(error)) < 300


def test_a_command_with_its_preview_has_the_documented_layout() -> None:
    q = tuple(float(k) for k in range(7))
    command = p.Command(5, p.Mode.POSITION, q, q, q, 0.005, (q, q, q, q), p.GripCommand(0.04, 20.0, 0.1))
    frame = p.encode(command)
    assert len(frame) == 12 + 40 + 8 * 7 * 7
    assert struct.unpack_from("<4sHHI", frame) == (b"PTRB", 2, 3, 432)
    assert struct.unpack_from("<QIBBBB3d", frame, 12) == (5, 5000, 1, 4, 1, 0, 0.04, 20.0, 0.1)
    assert struct.unpack_from("<7d", frame, 52) == q


def header(magic: bytes = b"PTRB", version: int = 2, kind: int = 3, length: int = 0) -> bytes:
    return struct.pack("<4sHHI", magic, version, kind, length)


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (
            header(magic=b"HTTP"),
            "the peer does not speak this protocol: its frame begins with b'HTTP'",
        ),
        (
            header(version=9),
            "the peer speaks version 9 of the protocol, this side version 2",
        ),
        (
            header(length=2**32 - 1),
            "a payload of 4294967295 bytes is longer than 33554432",
        ),
        (
            header(kind=77),
            "a message kind 77 of 0 bytes is malformed: 77 is not a valid Kind",
        ),
        (
            header(kind=7, length=2) + struct.pack("<H", 99),
            "a message STOP of 2 bytes is malformed: 99 is not a valid Stop",
        ),
        (
            p.encode(p.Command(1, p.Mode.HOLD, (0.0,), (0.0,), (0.0,)))[:-8] + struct.pack("<d", np.nan),
            "a number is not finite",
        ),
    ],
)
def test_what_is_wrong_with_a_frame_is_said(frame: bytes, said: str) -> None:
    one, other = socket.socketpair()
    with one, other:
        other.sendall(frame)
        with pytest.raises(p.ProtocolError) as raised:
            p.Channel(one).receive()
    assert str(raised.value) == said


def test_frames_may_come_in_pieces_and_together() -> None:
    one, other = socket.socketpair()
    with one, other:
        channel = p.Channel(one)
        frame = p.encode(p.Capture(3)) + p.encode(p.Bye())
        for k in range(len(frame)):
            other.send(frame[k : k + 1])
        assert [channel.receive(), channel.receive()] == [p.Capture(3), p.Bye()]
        other.close()
        with pytest.raises(p.ProtocolError, match="the peer has closed the connection"):
            channel.receive()


@pytest.mark.parametrize("text", ["robot", "host:", ":80", "1.2.3.4:99999", "unix:", "/" + "x" * 200])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(p.ProtocolError):
        p.Address.parse(text)


def test_an_address_beyond_this_machine_needs_a_token() -> None:
    for inside in ("/tmp/a.sock", "127.0.0.1:1", "[::1]:1", "localhost:1"):
        p.Address.parse(inside).require_token("")
    for outside in ("0.0.0.0:1", "192.168.1.4:5577", "robot.example:5577"):
        address = p.Address.parse(outside)
        address.require_token("secret")
        with pytest.raises(p.ProtocolError) as raised:
            address.require_token("")
        assert str(raised.value) == (
            f"{outside} is not on this machine's loopback; both sides need the same token in "
            "PICKTREE_ROBOT_TOKEN"
        )


def test_a_socket_in_use_is_not_taken_and_a_stale_one_is(tmp_path: Path) -> None:
    address = p.Address.parse(str(tmp_path / "a.sock"))
    with address.listen():
        assert os.stat(address.path).st_mode & 0o077 == 0
        with pytest.raises(OSError, match="another process listens"):
            address.listen()
    address.listen().close()


def test_a_picture_comes_back_from_its_data() -> None:
    rng = np.random.default_rng(0)
    colour, depth = rng.integers(0, 256, (5, 3, 3), np.uint8), rng.random((5, 3), np.float32)
    again = p.split_picture(p.join_picture(colour, depth), 3, 5)
    assert np.array_equal(again[0], colour) and np.array_equal(again[1], depth)


def test_the_protocol_needs_nothing_of_picktree() -> None:
    """An adapter may copy the file: alone, in a folder, it is imported."""
    code = "import protocol; print(protocol.encode(protocol.Bye()).hex())"
    folder = ROOT / "drivers"
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == p.encode(p.Bye()).hex()


def test_the_cell_imports_the_protocol_and_nothing_else_of_picktree() -> None:
    files = sorted((ROOT / "picktree_cell").glob("*.py"))
    assert len(files) > 5
    found: set[str] = set()
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.ImportFrom)
                and node.level == 0
                and (node.module or "").startswith("picktree")
            ):
                found |= {f"{node.module}.{alias.name}" for alias in node.names}
            elif isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names if alias.name.startswith("picktree")}
    assert found == {"picktree.drivers.protocol"}
