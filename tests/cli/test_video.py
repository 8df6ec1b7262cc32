"""picktree video and picktree snapshot: what they say, and what stands in their way."""

from __future__ import annotations

import json
from pathlib import Path

import av
import pytest

from picktree.apps.cli import answer
from picktree.logs.recording import decode_colour

from ..commands import Terminal

GOLDEN = Path(__file__).parents[1] / "logs" / "golden" / "format-2.mcap"
QUICK = ["--size", "128x80", "--processes", "1"]


def test_options_reach_the_film_and_it_is_described(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "film.gif"
    options = ["--from=0.5", "--to=2.5", "--speed=2", "--fps=5", "--view=top", "--show=both"]
    words = ["video", str(GOLDEN), "-o", str(output), *options, *QUICK]
    assert answer(words) == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert out.startswith(f"{output}: 1.0 s, 5 frames of 128 × 80, 0.0 MB, made in ")
    assert answer([*words, "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told.pop("wall") > 0
    size = output.stat().st_size
    assert told == {
        "path": str(output), "seconds": 1.0, "frames": 5, "fps": 5, "size": [128, 80], "bytes": size
    }  # fmt: skip
    with av.open(str(output)) as film:
        assert sum(1 for _ in film.decode(video=0)) == 5


def test_bad_input_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert answer(["video", str(GOLDEN), "-o", "film.mov"]) == 2
    assert capsys.readouterr() == ("", "film.mov: a film is a file that ends in .mp4 or .gif\n")
    assert answer(["video", str(GOLDEN), "-o", "film.mp4", "--size", "big"]) == 2
    assert capsys.readouterr() == ("", "size 'big': write WIDTHxHEIGHT in pixels, as in 960x600\n")
    assert list(tmp_path.iterdir()) == []


def test_a_terminal_shows_how_long_it_will_take_and_an_interrupt_leaves_nothing(tmp_path: Path) -> None:
    # Slow enough to be caught at it: 5,900 frames by two processes.
    words = ["video", str(GOLDEN), "-o", str(tmp_path / "film.mp4"), "--speed", "0.01", "--processes", "2"]
    terminal = Terminal(words)
    assert "of 5900, " in terminal.until(" left")
    terminal.press(b"\x03")
    assert terminal.end() == 130
    assert list(tmp_path.iterdir()) == []


def test_a_snapshot_has_a_view_and_a_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures: list[bytes] = []
    for view in ("corner", "top"):
        output = tmp_path / f"{view}.png"
        options = ["--at", "1", "-o", str(output), "--size", "160x100", "--view", view]
        assert answer(["snapshot", str(GOLDEN), *options]) == 0
        assert capsys.readouterr().out == f"{output}\n"
        pictures.append(output.read_bytes())
        assert decode_colour(pictures[-1]).shape == (100, 160, 3)
    assert pictures[0] != pictures[1]
