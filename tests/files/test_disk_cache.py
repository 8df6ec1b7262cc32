"""Disk cache: found by content, whole or not at all, bounded, and without effect on results."""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from picktree.apps.cli import answer
from picktree.files import disk_cache
from picktree.files.disk_cache import VARIABLE, cache_content, cache_folder, cached_arrays

COUNTS = np.arange(6, dtype=np.int32).reshape(2, 3)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(disk_cache, "_recent", {})
    yield tmp_path / "cache"


class Computation:
    """Computation that counts how often it runs."""

    def __init__(self, **arrays: NDArray[Any]) -> None:
        self.arrays = arrays or {"counts": COUNTS}
        self.runs = 0

    def __call__(self) -> Mapping[str, NDArray[Any]]:
        self.runs += 1
        return self.arrays


def forget() -> None:
    """Begin as another process would."""
    disk_cache._recent.clear()  # pyright: ignore[reportPrivateUsage]


def entries(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def test_a_later_process_finds_what_an_earlier_one_computed(folder: Path) -> None:
    compute = Computation(
        counts=COUNTS, none=np.zeros((0, 3)), single=np.array(0.1), columns=np.asfortranarray(COUNTS)
    )
    for _ in range(3):
        found = cached_arrays("kind", ["a"], ["numpy"], compute)
        assert list(found) == list(compute.arrays)
        for name, array in compute.arrays.items():
            assert found[name].dtype == array.dtype and found[name].shape == array.shape
            assert found[name].tobytes() == array.tobytes()
            assert found[name].flags.c_contiguous and found[name].flags.writeable
        found["counts"][:] = -1  # the arrays are the caller's own
        forget()
    assert compute.runs == 1
    assert len(entries(folder)) == 1


def test_any_other_input_is_another_entry(folder: Path, tmp_path: Path) -> None:
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("v 1 2 3")
    compute = Computation()
    cached_arrays("kind", ["a", "b"], ["numpy"], compute)
    cached_arrays("kind", ["ab"], ["numpy"], compute)
    cached_arrays("kind", ["a", "b"], ["scipy"], compute)
    cached_arrays("kind", [mesh], [], compute)
    cached_arrays("kind", [], [mesh], compute)
    assert compute.runs == len(entries(folder)) == 5
    mesh.write_text("v 1 2 4")
    cached_arrays("kind", [mesh], [], compute)
    assert compute.runs == 6
    cached_arrays("kind", [b"v 1 2 4"], [], compute)  # it is the content that counts
    assert compute.runs == 6


@pytest.mark.parametrize("damage", [b"", b"short", b"flip", b"none"])
def test_a_damaged_entry_is_made_again(folder: Path, damage: bytes) -> None:
    compute = Computation()
    cached_arrays("kind", ["a"], [], compute)
    (entry,) = entries(folder)
    whole = entry.read_bytes()
    flipped = whole[:-1] + bytes([whole[-1] ^ 1])
    entry.write_bytes({b"flip": flipped, b"short": whole[:-1]}.get(damage, b"x" * 100 * (damage == b"none")))
    forget()
    assert cached_arrays("kind", ["a"], [], compute)["counts"].tolist() == COUNTS.tolist()
    assert compute.runs == 2
    assert entry.read_bytes() == whole


def test_a_folder_that_cannot_be_made_costs_only_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    compute = Computation()
    for _ in range(2):
        assert cached_arrays("kind", ["a"], [], compute)["counts"].tolist() == COUNTS.tolist()
        forget()
    assert compute.runs == 2
    assert cache_content().entries == 0
    assert capfd.readouterr() == ("", "")


def test_an_input_that_cannot_be_read_is_for_the_computation_to_report(tmp_path: Path) -> None:
    compute = Computation()
    assert cached_arrays("kind", [tmp_path / "absent"], [], compute)["counts"].tolist() == COUNTS.tolist()
    assert cache_content().entries == 0


def test_a_computation_that_fails_leaves_nothing() -> None:
    def fail() -> Mapping[str, NDArray[Any]]:
        raise ValueError("no mesh")

    with pytest.raises(ValueError, match="no mesh"):
        cached_arrays("kind", ["a"], [], fail)
    assert cache_content().entries == 0


def _on_a_full_disk(folder: Path) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
    big = np.arange(1000.0)
    found = cached_arrays("kind", ["a"], [], lambda: {"big": big})
    os._exit(0 if found["big"].tobytes() == big.tobytes() and not entries(folder) else 1)


def test_a_full_disk_keeps_nothing_unfinished(folder: Path) -> None:
    assert _exit_codes(
        [multiprocessing.get_context("fork").Process(target=_on_a_full_disk, args=(folder,))]
    ) == [0]


def _compute_many(start: Any) -> None:
    start.wait()
    for n in range(200):
        value = np.full(2000, n % 20)
        found = cached_arrays("kind", [str(n % 20)], [], lambda value=value: {"value": value})
        forget()
        if n % 50 == 49:
            disk_cache.clear_cache()
        if not np.array_equal(found["value"], value):
            os._exit(1)


def test_processes_at_once_see_whole_entries_only(folder: Path) -> None:
    context = multiprocessing.get_context("fork")
    start = context.Event()
    processes = [context.Process(target=_compute_many, args=(start,)) for _ in range(4)]
    start.set()
    assert _exit_codes(processes) == [0, 0, 0, 0]
    assert all(path.suffix == ".entry" for path in entries(folder))


def _exit_codes(processes: list[Any]) -> list[int | None]:
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    return [process.exitcode for process in processes]


def test_what_was_used_longest_ago_goes_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compute = Computation()
    names: dict[str, Path] = {}
    for n, key in enumerate("abc"):
        cached_arrays("kind", [key], [], compute)
        (names[key],) = set(entries(folder)) - set(names.values())
        os.utime(names[key], (n, n))
    size = names["a"].stat().st_size
    forget()
    cached_arrays("kind", ["a"], [], compute)  # it is now the one that was used last
    monkeypatch.setattr(disk_cache, "MAX_BYTES", 3 * size)
    cached_arrays("kind", ["d"], [], compute)
    assert names["a"].exists() and not names["b"].exists() and names["c"].exists()
    assert cache_content().size == 3 * size


def test_the_folder_is_the_usual_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.setenv(VARIABLE, "")
    assert cache_folder() is None
    monkeypatch.delenv(VARIABLE)
    assert cache_folder() == tmp_path / "xdg" / "picktree"
    for no_folder in ("relative", ""):
        monkeypatch.setenv("XDG_CACHE_HOME", no_folder)
        assert cache_folder() == tmp_path / ".cache" / "picktree"


def test_the_command_shows_and_clears(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["cache"]) == 0
    assert capsys.readouterr().out == f"{folder}: 0 entries, 0.0 MB\n"
    cached_arrays("kind", ["a"], [], lambda: {"big": np.zeros(1_000_000, np.uint8)})
    (folder / "notes.txt").write_text("somebody else's")
    assert answer(["cache"]) == 0
    assert capsys.readouterr().out == f"{folder}: 1 entry, 1.0 MB\n"
    assert answer(["cache", "clear"]) == 0
    assert capsys.readouterr().out == f"{folder}: 1 entry, 1.0 MB, deleted\n"
    assert [path.name for path in entries(folder)] == ["notes.txt"]
    assert answer(["cache", "empty"]) == 2
    assert "'empty' is not one of 'clear'" in capsys.readouterr().err


def test_the_command_without_a_cache(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLE, "")
    assert answer(["cache"]) == 0
    assert capsys.readouterr().out == "no cache: PICKTREE_CACHE is empty, or there is no home directory\n"
