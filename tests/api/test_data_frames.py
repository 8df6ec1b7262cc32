"""Tables as pandas takes them: belief, results of queries, readings of joints, gripper and wrist."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import picktree as pt
from picktree.apps.batch import QueryResult
from picktree.logs import PandasTable, install_command
from picktree.logs.series import GripperSeries, JointSeries, WrenchSeries

from ..needs import PANDAS, needs

TIMES = np.array([0.05, 0.1])
TABLES = {
    "joints": JointSeries(("a", "b"), TIMES, *(np.arange(4.0).reshape(2, 2) + n for n in (0, 10, 20))),
    "gripper": GripperSeries(TIMES, np.array([0.08, 0.04]), np.array([0.0, 20.0])),
    "wrench": WrenchSeries(TIMES, np.arange(6.0).reshape(2, 3), np.arange(6.0, 12.0).reshape(2, 3)),
    "query": QueryResult(("seed", "status"), ((1, "success"), (2, None))),
}


def test_rows_have_the_names_of_their_columns() -> None:
    assert list(TABLES["joints"])[1] == {
        "time": 0.1, "a.position": 2.0, "a.velocity": 12.0, "a.effort": 22.0,
        "b.position": 3.0, "b.velocity": 13.0, "b.effort": 23.0,
    }  # fmt: skip
    assert list(TABLES["gripper"]) == [
        {"time": 0.05, "width": 0.08, "force": 0.0},
        {"time": 0.1, "width": 0.04, "force": 20.0},
    ]
    assert next(iter(TABLES["wrench"])) == {
        "time": 0.05, "force.x": 0.0, "force.y": 1.0, "force.z": 2.0,
        "torque.x": 6.0, "torque.y": 7.0, "torque.z": 8.0,
    }  # fmt: skip
    assert list(TABLES["query"]) == [{"seed": 1, "status": "success"}, {"seed": 2, "status": None}]


def test_an_object_of_the_belief_is_a_row() -> None:
    with pt.Cell("sort_small", backend="kinematic", seed=3) as cell:
        assert cell.belief.columns_by_name() == {}
        cell.run(pt.Observe(camera="overhead"))
        first, *_ = cell.belief
        assert (first["id"], first["form"]) == (first.id, first.belief.form)
        assert tuple(first[axis] for axis in "xyz") == first.pose.position
        columns = cell.belief.columns_by_name()
    assert list(columns) == list(first)
    assert {len(values) for values in columns.values()} == {4}
    assert first == first and first != dict(first)


@needs(PANDAS)
@pytest.mark.parametrize("name", TABLES)
def test_pandas_takes_a_table(name: str) -> None:
    import pandas

    table = TABLES[name]
    made = table.to_pandas()
    assert list(made.columns) == list(table.columns_by_name())
    assert len(made) == 2
    assert pandas.DataFrame(table).to_dict("records") == made.to_dict("records")


@needs(PANDAS)
def test_pandas_takes_the_belief() -> None:
    import pandas

    with pt.Cell("sort_small", backend="kinematic", seed=3) as cell:
        assert len(cell.belief.to_pandas()) == len(pandas.DataFrame(cell.belief)) == 0
        cell.run(pt.Observe(camera="overhead"))
        made = cell.belief.to_pandas()
        assert pandas.DataFrame(cell.belief).to_dict("records") == made.to_dict("records")
        assert [row["id"] for row in made.to_dict("records")] == [item.id for item in cell.belief]


def test_without_pandas_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    table: PandasTable = TABLES["query"]
    with pytest.raises(pt.PicktreeError) as caught:
        table.to_pandas()
    assert str(caught.value) == f"A data frame needs the extra 'pandas': {install_command('pandas')}"
