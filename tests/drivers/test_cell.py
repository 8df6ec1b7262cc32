"""The MuJoCo cell by itself: what its robot side enforces, its sensors, its faults and its files."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.drivers import protocol as p

pytest.importorskip("mujoco")

import mujoco

from picktree_cell.cell_description import Cell, CellError, parse_cell, read_cell
from picktree_cell.cell_faults import CellFaults, read_faults
from picktree_cell.cell_score import score
from picktree_cell.film import Film
from picktree_cell.plant import Plant
from picktree_cell.robot_model import TCP, WRIST, MakersModel, robot_spec
from picktree_cell.server import CellServer

from .served_cell import write_cell

ROOT = Path(__file__).parents[2]
EXACT = CellFaults(wrench_noise=0.0, inertia_error=0.0, hand_mass_error=0.0)


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    return read_cell(write_cell(tmp_path_factory.mktemp("cell")))


def command(plant: Plant, position: np.ndarray, seconds: float = 0.005, **more: object) -> p.Command:
    q, n = tuple(position.tolist()), len(position)
    zero = (0.0,) * n
    return p.Command(plant.command + 1, p.Mode.POSITION, q, zero, zero, seconds, **more)  # type: ignore[arg-type]


def move(plant: Plant, speed: float, periods: int = 40) -> np.ndarray:
    """Move the last joint at `speed` rad/s, and return its commanded configuration."""
    q = np.array(plant.cell.robot.home)
    for _ in range(periods):
        q[-1] += speed * 0.005
        ahead = tuple(tuple((q + np.eye(7)[6] * speed * (t - 0.005)).tolist()) for t in p.PREVIEW_TIMES)
        plant.take(command(plant, q, ahead=ahead))
        plant.advance(0.005)
    return q


def test_the_wrist_reads_the_weight_of_the_hand_in_its_own_axes(cell: Cell) -> None:
    plant = Plant(cell, EXACT, 0)
    flange = plant.data.site_xmat[plant.parts.wrist].reshape(3, 3)
    in_world = flange @ plant.reading().wrench[:3]
    weight = 9.81 * plant.parts.model.body_subtreemass[plant.parts.hand]
    assert np.allclose(in_world, [0.0, 0.0, -weight], atol=0.02)
    assert np.abs(flange[2, 2]) > 0.9  # the hand points down, so that a wrong sign would show


def test_the_robot_goes_on_along_the_preview_and_brakes_after_150_ms(cell: Cell) -> None:
    plant = Plant(cell, EXACT, 0)
    q = move(plant, 0.5)
    plant.advance(0.1)
    assert plant.stop is p.Stop.NONE
    assert plant.reading().position[-1] == pytest.approx(q[-1] + 0.5 * 0.1, abs=1e-3)
    plant.advance(0.5)
    reading = plant.reading()
    assert plant.stop is p.Stop.SILENCE
    assert np.abs(reading.velocity).max() < 0.01
    assert reading.position[-1] == pytest.approx(q[-1] + 0.5 * 0.145 + 0.5**2 / (2 * 12.0), abs=5e-3)
    plant.take(command(plant, q))
    plant.advance(0.005)
    assert plant.stop is p.Stop.SILENCE  # until it is acknowledged
    plant.clear()
    assert plant.stop is p.Stop.NONE


def test_the_robot_stops_by_itself_beyond_its_limits(cell: Cell) -> None:
    plant = Plant(cell, EXACT, 0)
    plant.take(command(plant, np.array(cell.robot.home) + 0.2))
    plant.advance(0.005)
    assert plant.stop is p.Stop.JUMP
    plant = Plant(replace(cell, workspace=(-1, -1, -1, 1, 1, 0.3)), EXACT, 0)
    plant.advance(0.005)
    assert plant.stop is p.Stop.WORKSPACE
    plant = Plant(cell, EXACT, 0)
    q = np.array(cell.robot.home)
    for _ in range(400):  # the forearm meets the table, which the wrist does not feel
        q[1] += 0.006
        plant.take(command(plant, q))
        plant.advance(0.005)
    assert plant.stop is p.Stop.TRACKING
    plant = Plant(replace(cell, force=1.0), EXACT, 0)
    move(plant, 0.1)
    assert plant.stop is p.Stop.NONE
    q = np.array(cell.robot.home)
    for _ in range(40):
        q[0] += 0.005
        plant.take(command(plant, q))
        plant.advance(0.005)
    assert plant.stop is p.Stop.FORCE


def test_the_robot_refuses_more_than_the_share_of_its_speeds(cell: Cell) -> None:
    """The path ahead counts, too, so that no jump can hide in it."""
    plant = Plant(cell, EXACT, 0)
    plant.speed = 0.1
    most = 0.1 * cell.robot.joints[-1].velocity
    q = move(plant, most)
    assert plant.stop is p.Stop.NONE
    ahead = tuple(tuple((q + np.eye(7)[6] * 2 * most * t).tolist()) for t in p.PREVIEW_TIMES)
    plant.take(command(plant, q, ahead=ahead))
    plant.advance(0.005)
    assert plant.stop is p.Stop.SPEED
    plant = Plant(cell, EXACT, 0)
    move(plant, 1.2 * most + 0.03)
    assert plant.stop is p.Stop.NONE  # at full speed that is slow
    plant = Plant(cell, EXACT, 0)
    plant.speed = 0.1
    move(plant, 1.2 * most + 0.03, 2)
    assert plant.stop is p.Stop.SPEED


def test_a_late_gripper_says_that_it_is_busy(cell: Cell) -> None:
    plant = Plant(cell, replace(EXACT, gripper_latency=0.2), 0)
    home = np.array(cell.robot.home)
    plant.take(command(plant, home, grip=p.GripCommand(0.02, 20.0)))
    plant.advance(0.15)
    assert plant.reading().busy and plant.width > 0.079
    plant.advance(0.8)
    assert not plant.reading().busy
    assert plant.width == pytest.approx(0.02, abs=1e-3)


def test_the_fingers_press_with_the_commanded_force(cell: Cell) -> None:
    """The effort that the URDF gives the finger joints, 20 N, is not that of the gripper."""
    plant = Plant(cell, EXACT, 0)
    item = next(item.id for item in cell.items if item.form == "box")
    plant.parts.model.opt.gravity[:] = 0.0
    at = plant.parts.item_q[item]
    plant.data.qpos[at : at + 3], turn = plant.tcp()
    mujoco.mju_mat2Quat(plant.data.qpos[at + 3 : at + 7], turn.ravel())
    plant.take(command(plant, np.array(cell.robot.home), grip=p.GripCommand(0.0, 45.0)))
    plant.advance(1.0)
    assert plant.width > 0.01
    assert plant.data.qfrc_actuator[plant.parts.finger_v] == pytest.approx([-45.0, -45.0])
    assert plant.reading().gripper[2] == pytest.approx(45.0)


def test_the_state_is_as_old_as_its_latency(cell: Cell) -> None:
    plant = Plant(cell, replace(EXACT, state_latency=0.03), 0)
    move(plant, 0.5)
    assert plant.reading().time == pytest.approx(plant.time - 0.03)


def test_the_cell_scores_what_lies_where(cell: Cell) -> None:
    plant = Plant(cell, EXACT, 0)
    before = score(plant)
    assert (before["sorted"], before["total"]) == (0, 4)
    item = cell.items[0]
    bin_ = next(place for place in cell.places if place.id == item.destination)
    q = plant.parts.item_q[item.id]
    plant.data.qpos[q : q + 3] = np.array(bin_.frame.at) + np.array([0.0, 0.0, 0.05])
    plant.advance(0.6)
    after = score(plant)
    assert after["sorted"] == 1 and after["items"][item.id]["within"] == bin_.id


def test_two_cells_of_one_seed_are_the_same(cell: Cell) -> None:
    def states(seed: int) -> bytes:
        plant = Plant(cell, CellFaults(), seed)
        move(plant, 0.3, 10)
        seen = CellServer(plant, seed)._cameras[0].capture(plant.data, plant.tcp())
        assert seen is not None
        return plant.data.qpos.tobytes() + plant.reading().wrench.tobytes() + seen[1].tobytes()

    assert states(3) == states(3) != states(4)


def test_a_camera_sees_the_items_where_they_are(cell: Cell) -> None:
    faults = replace(EXACT, dropped_pictures=0.0)
    flat = replace(cell, cameras=(replace(cell.cameras[0], depth_noise=0.0, edge_dropout=0.0),))
    plant = Plant(flat, faults, 0)
    camera = CellServer(plant, 0)._cameras[0]
    seen = camera.capture(plant.data, plant.tcp())
    assert seen is not None
    position, rotation = camera._frame(plant.tcp())
    for item in flat.items:
        q = plant.parts.item_q[item.id]
        x, y, z = rotation.T @ (plant.data.qpos[q : q + 3] - position)
        column, row = (
            round(camera.focal * x / z + camera.centre[0]),
            round(camera.focal * y / z + camera.centre[1]),
        )
        assert 0.0 < z - seen[1][row, column] < 0.05
        brightest = int(np.argmax(seen[0][row, column]))
        assert brightest == int(np.argmax(item.colour))


def test_a_lost_picture_is_none(cell: Cell) -> None:
    plant = Plant(cell, replace(EXACT, dropped_pictures=1.0), 0)
    assert CellServer(plant, 0)._cameras[0].capture(plant.data, plant.tcp()) is None


def serving(server: CellServer, connection: socket.socket, *, moves: bool = True) -> threading.Thread:
    """Serve a client in a thread; what breaks the protocol ends it."""

    def serve() -> None:
        with suppress(p.ProtocolError):
            server.serve(p.Channel(connection), moves=moves)

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


def talk(server: CellServer, *messages: p.Message) -> list[p.Message]:
    """Serve a client that sends these messages; return the answers."""
    one, other = socket.socketpair()
    answers: list[p.Message] = []
    thread = serving(server, one)
    with one, other:
        channel = p.Channel(other)
        for message in messages:
            channel.send(message)
            if not isinstance(message, p.Bye):
                answers.append(channel.receive())
        thread.join(20)
    return answers


def test_a_client_is_served_and_a_wrong_one_is_refused(cell: Cell) -> None:
    plant = Plant(cell, EXACT, 0)
    home = np.array(cell.robot.home)
    welcome, state, picture = talk(
        CellServer(plant, 0, "secret"),
        p.Hello(p.Wish(0), "secret"),
        command(plant, home),
        p.Capture(0),
        p.Bye(),
    )
    assert isinstance(welcome, p.Welcome) and welcome.joints[0].name == "panda_joint1"
    assert isinstance(state, p.State) and state.time == pytest.approx(0.005)
    assert isinstance(picture, p.Picture) and len(picture.data) == welcome.cameras[0].picture_size
    (refused,) = talk(CellServer(plant, 0, "secret"), p.Hello(p.Wish(0), "guess"))
    assert refused == p.Refusal(p.Refused.TOKEN, "the token is not the robot's")
    short = p.Command(1, p.Mode.POSITION, (0.0,), (0.0,), (0.0,))
    _, refused = talk(CellServer(plant, 0), p.Hello(p.Wish(0)), short)
    assert refused == p.Refusal(p.Refused.MESSAGE, "a command has 1 joints, the robot 7")
    torque = replace(command(plant, home), mode=p.Mode.TORQUE)
    _, refused = talk(CellServer(plant, 0, mode=p.Capability.POSITION), p.Hello(p.Wish(0)), torque)
    assert refused == p.Refusal(p.Refused.MESSAGE, "the robot takes no commands in mode TORQUE")


def test_an_observer_reads_beside_the_client_that_moves_and_changes_nothing(cell: Cell) -> None:
    alone, plant = Plant(cell, CellFaults(), 0), Plant(cell, CellFaults(), 0)
    server, home = CellServer(plant, 0), np.array(cell.robot.home)
    (first, mine), (other, theirs) = socket.socketpair(), socket.socketpair()
    threads = [serving(server, first), serving(server, other, moves=False)]
    with first, mine, other, theirs:
        mover, observer = p.Channel(mine), p.Channel(theirs)
        for channel, wish in ((mover, p.Wish(0)), (observer, p.Wish.OBSERVE)):
            channel.send(p.Hello(wish))
            assert isinstance(channel.receive(), p.Welcome)
        observer.send(p.Observe(0.02))  # answered when the robot's clock is there
        state: p.Message = p.Bye()
        for _ in range(4):
            mover.send(command(plant, home))
            state = mover.receive()
        seen = observer.receive()
        observer.send(p.Capture(0))
        picture = observer.receive()
        assert isinstance(seen, p.State) and isinstance(state, p.State) and isinstance(picture, p.Picture)
        assert seen.time == pytest.approx(0.02) and picture.given and picture.data
        assert seen.position == state.position and seen.wrench != state.wrench
        observer.send(p.Observe(10.0))
        mover.send(p.Bye())
        assert isinstance(observer.receive(), p.State)  # nobody moves the robot any more
        observer.send(p.StopRequest())
        assert observer.receive() == p.Refusal(
            p.Refused.MESSAGE, "a client that only observes sent StopRequest"
        )
        for thread in threads:
            thread.join(20)
    (_, *answers) = talk(CellServer(alone, 0), p.Hello(p.Wish(0)), *[command(alone, home)] * 4, p.Bye())
    assert answers[-1] == replace(state, command=1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"picktree_cell": 9}, "cell: the file has version 9, this program reads version 1"),
        ({"force": -1}, "cell: 'force' is a number above 0"),
        ({"fixtures": [{"id": 3}]}, "cell: fixtures[0]: 'id' is a text"),
        ({"robot": []}, "cell: robot: an object is expected, not list"),
    ],
)
def test_what_is_wrong_with_a_cell_file_is_said(tmp_path: Path, change: dict[str, object], said: str) -> None:
    data = json.loads(write_cell(tmp_path).read_text())
    with pytest.raises(CellError) as raised:
        parse_cell({**data, **change})
    assert str(raised.value) == said


def test_what_is_no_fault_is_said(tmp_path: Path) -> None:
    file = tmp_path / "faults.json"
    file.write_text('{"gripper_delay": 1}')
    with pytest.raises(
        CellError, match="'gripper_delay' is no fault of the cell; the faults are gripper_latency"
    ):
        read_faults(file)
    file.write_text('{"gripper_latency": -1}')
    with pytest.raises(CellError) as raised:
        read_faults(file)
    assert str(raised.value) == f"{file}: gripper_latency is -1; it is a number of at least 0"


def makers_file(cell: Cell, folder: Path) -> Path:
    """Write the cell's robot as an MJCF file with names and motors of its own."""
    spec = robot_spec(cell.robot, None).spec
    spec.delete(next(site for site in spec.sites if site.name == WRIST))
    spec.delete(next(site for site in spec.sites if site.name == TCP))
    spec.add_actuator(name="own", target=cell.robot.joints[0].name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    spec.compile()
    for name, data in cell.robot.meshes.items():
        (folder / name).write_bytes(data)
    file = folder / "robot.xml"
    file.write_text(spec.to_xml().replace("panda_", "fr3_"))
    return file


def test_the_robot_is_that_of_its_makers_model(cell: Cell, tmp_path: Path) -> None:
    """Wrist and TCP stay where the cell file has them; another arm is refused."""
    file = makers_file(cell, tmp_path)
    by_model = Plant(cell, EXACT, 0, MakersModel(file, (("panda_", "fr3_"),)))
    by_urdf = Plant(cell, EXACT, 0)
    for one, other in zip(by_model.tcp(), by_urdf.tcp(), strict=True):
        assert np.allclose(one, other, atol=2e-4)
    assert np.allclose(by_model.reading().wrench, by_urdf.reading().wrench, atol=0.01)
    move(by_model, 0.3)
    assert by_model.stop is p.Stop.NONE
    assert by_model.parts.model.nu == 9  # the motors of the model are gone
    with pytest.raises(CellError, match=r"robot\.xml has no joint 'panda_joint1'; it has fr3_joint1"):
        Plant(cell, EXACT, 0, MakersModel(file))
    file.write_text(file.read_text().replace('pos="0 -0.316 0"', 'pos="0 -0.3 0"'))
    with pytest.raises(CellError) as raised:
        Plant(cell, EXACT, 0, MakersModel(file, (("panda_", "fr3_"),)))
    assert str(raised.value).startswith(f"{file}: its flange is ")
    assert str(raised.value).endswith("of panda: this is the model of another arm, or of another base")


def test_a_film_shows_the_cell_from_outside(cell: Cell, tmp_path: Path) -> None:
    """One picture in a tenth of a second of the robot's time, with all items and the robot's shadow."""
    av = pytest.importorskip("av")
    plant = Plant(cell, EXACT, 0)
    film = Film(tmp_path / "film.gif", plant)
    for _ in range(25):
        film.follow()
        plant.advance(0.01)
    film.close()
    with av.open(str(tmp_path / "film.gif")) as made:
        pictures = [frame.to_ndarray(format="rgb24").astype(int) for frame in made.decode(video=0)]
    assert len(pictures) == 3
    for number in range(3):  # red, green and blue are those of items
        others = np.delete(pictures[0], number, axis=2).max(axis=2)
        assert (pictures[0][:, :, number] > 2 * others + 40).sum() > 20
    with pytest.raises(CellError, match=r"film\.avi: a film is a file that ends in \.mp4 or \.gif"):
        Film(tmp_path / "film.avi", plant)
    with pytest.raises(CellError, match=r"film\.gif: the film cannot be written: No such file or directory"):
        Film(tmp_path / "none" / "film.gif", plant)


def test_a_graphics_library_that_is_not_there_is_named(cell: Cell, tmp_path: Path) -> None:
    environment = {**os.environ, "MUJOCO_GL": "nothing"}
    command = [sys.executable, "-m", "picktree_cell", str(write_cell(tmp_path)), "--camera", "gl"]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith(
        "--camera gl: the graphics library 'nothing' of MUJOCO_GL does not work here (invalid value for "
    )
