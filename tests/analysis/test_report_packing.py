"""What a report packs is what its page unpacks; the page's own code reads it here, in node."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from picktree.analysis.report import Packable, Section, pack
from picktree.analysis.report.packing import NAN_LEVEL, quantise
from picktree.analysis.report.report import PAGE_FOLDER

from ..needs import NODE

READER = """
import { unpack } from %s;
let text = "";
for await (const part of process.stdin) text += part;
const plain = (value) => {
  if (value?.shape) {
    const values = [...value].map((number) => (Number.isNaN(number) ? null : number));
    return { kind: value.constructor.name, shape: value.shape, values };
  }
  if (Array.isArray(value)) return value.map(plain);
  if (value && typeof value === "object") {
    return Object.fromEntries(Object.entries(value).map(([key, below]) => [key, plain(below)]));
  }
  return value;
};
console.log(JSON.stringify(plain(await unpack(text))));
"""


def unpacked(*sections: Section) -> dict[str, object]:
    """As the page has it; each array as its kind, shape and values."""
    NODE.require()
    module = json.dumps((PAGE_FOLDER / "src" / "unpacking.js").as_uri())
    done = subprocess.run(
        ["node", "--input-type=module", "-e", READER % module],
        input=pack(sections),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_plain_values_and_arrays_of_every_kind_come_back() -> None:
    kinds = {
        "u1": "Uint8Array", "i1": "Int8Array", "u2": "Uint16Array", "i2": "Int16Array", "u4": "Uint32Array",
        "i4": "Int32Array", "f4": "Float32Array", "f8": "Float64Array",
    }  # fmt: skip
    words: dict[str, Packable] = {"text": "größer <b>", "none": None, "list": [1, True, {"x": 2.5}]}
    arrays: dict[str, Packable] = {kind: np.array([[1, 2, 3], [4, 5, 6]], dtype=kind) for kind in kinds}
    flags = np.array([True, False])
    found = unpacked(Section("words", words), Section("arrays", arrays), Section("flags", flags))
    assert found == {
        "words": words,
        "arrays": {
            kind: {"kind": name, "shape": [2, 3], "values": [1, 2, 3, 4, 5, 6]}
            for kind, name in kinds.items()
        },
        "flags": {"kind": "Uint8Array", "shape": [2], "values": [1, 0]},
    }


@pytest.mark.parametrize("spread", [1e-3, 1.0, 3e4])
def test_quantised_numbers_come_back_to_half_a_step(spread: float) -> None:
    values = np.random.default_rng(4).uniform(-spread, spread, (50, 2, 3))
    values[7, 1] = np.nan
    found = unpacked(Section("x", quantise(values, 1e-4)))["x"]
    assert isinstance(found, dict)
    assert (found["kind"], found["shape"]) == ("Float32Array", [50, 2, 3])
    read = np.array([np.nan if value is None else value for value in found["values"]]).reshape(50, 2, 3)
    np.testing.assert_allclose(read, values, atol=5.1e-5, rtol=1e-7)


@pytest.mark.parametrize("shape", [(0,), (0, 3), (1,), (4, 0)])
def test_arrays_without_numbers_keep_their_shape(shape: tuple[int, ...]) -> None:
    found = unpacked(Section("x", quantise(np.zeros(shape), 1.0)))["x"]
    assert found == {"kind": "Float32Array", "shape": list(shape), "values": [0] * int(np.prod(shape))}


def test_what_is_still_takes_next_to_nothing() -> None:
    still = np.tile(np.random.default_rng(4).uniform(-1, 1, 7), (6000, 1))
    assert len(pack([Section("x", quantise(still, 1e-4))])) < 400


def test_a_step_that_is_too_fine_is_refused() -> None:
    assert quantise(np.array([2.0e5]), 1e-4).levels.tolist() == [2_000_000_000]
    assert quantise(np.array([np.nan]), 1e-4).levels.tolist() == [NAN_LEVEL]
    with pytest.raises(ValueError, match=r"^a step of 0\.0001 is too fine for these numbers$"):
        quantise(np.array([3.0e5]), 1e-4)


def test_what_json_cannot_hold_is_refused() -> None:
    with pytest.raises(TypeError, match=r"^a report cannot hold an array of int64$"):
        pack([Section("x", np.array([1, 2]))])
    with pytest.raises(TypeError, match=r"^a report cannot hold a PosixPath$"):
        pack([Section("x", Path("/"))])  # pyright: ignore[reportArgumentType]
