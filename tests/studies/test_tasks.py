"""Trials as tasks: what a key depends on, and how rows are kept."""

from __future__ import annotations

import errno
import json
import math
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.studies.tasks import journal, table
from srl.studies.tasks.environment import decisive, differences
from srl.studies.tasks.task import DONE, FAILED, Row, TrialTask, Value, flat
from srl.studies.toolkit.errors import StudyError

HERE = {"numpy": "2.0", "program": "abc", "blas": "openblas Haswell"}
TASK = TrialTask.of("toy", "toy", 3, {"force": 1.5, "way": [1, 2]}, profile="sixth-finger")

texts = st.text(st.characters(codec="utf-8"), max_size=30)
names = texts.map(lambda text: f"v {text}")
kinds = st.sampled_from([
    st.floats(allow_nan=True, allow_infinity=True), st.integers(-(2**63), 2**63 - 1), st.booleans(), texts,
])  # fmt: skip


@st.composite
def columns(draw: st.DrawFn) -> list[dict[str, Value]]:
    """Rows of which each column has one kind of value, and holes."""
    kinds_ = draw(st.dictionaries(names, kinds, max_size=5))
    one = st.fixed_dictionaries({}, optional={name: st.none() | kind for name, kind in kinds_.items()})
    rows: list[dict[str, Value]] = draw(st.lists(one, max_size=6))
    return rows


def row(values: dict[str, Value], number: int = 0, state: str = DONE) -> Row:
    return Row(f"{number:032x}", TASK, "hash", state, values, "", 0.25, "host:1", dict(HERE))


def same(one: Any, other: Any) -> bool:
    """Equal bit for bit, NaN and the sign of zero included."""
    return repr(one) == repr(other)


@pytest.mark.slow
@given(columns())
def test_a_row_comes_back_from_the_journal_as_it_was(rows: list[dict[str, Value]]) -> None:
    for values in rows:
        back = journal.decoded(journal.encoded(row(values)))
        assert back is not None
        assert same(back, row(values))


@pytest.mark.slow
@given(columns())
def test_rows_come_back_from_parquet_as_they_were(tmp_path_factory: pytest.TempPathFactory, rows: list) -> None:
    file = tmp_path_factory.mktemp("p") / table.FILE
    table.write(file, [row(values, i) for i, values in enumerate(rows)])
    for i, (back, values) in enumerate(zip(table.read(file), rows, strict=True)):
        assert all(same(back[name], value) for name, value in values.items())
        assert all(back[name] is None for name in back.keys() - values.keys() if name.startswith("v "))
        assert (back["key"], back["seed"], back["state"]) == (f"{i:032x}", 3, DONE)
        assert json.loads(back["parameters"]) == TASK.parameters


@given(st.data())
def test_a_line_of_which_anything_is_missing_or_changed_is_no_row(data: st.DataObject) -> None:
    line = journal.encoded(row({"x": 1.0}))
    assert journal.decoded(line[: data.draw(st.integers(0, len(line) - 1))]) is None
    place, flip = data.draw(st.integers(0, len(line) - 1)), data.draw(st.integers(1, 255))
    assert journal.decoded(line[:place] + bytes([line[place] ^ flip]) + line[place + 1 :]) is None


@pytest.mark.parametrize("cut", [1, 30, 200])
def test_a_torn_tail_is_cut_off_and_the_rest_is_kept(tmp_path: Path, cut: int) -> None:
    with journal.opened(tmp_path) as one:
        one.append([row({"x": float(i)}, i) for i in range(3)])
    file = tmp_path / journal.FILE
    os.truncate(file, file.stat().st_size - cut)
    with journal.opened(tmp_path) as two:
        assert (two.torn, two.broken, len(two.rows)) == (True, 0, 2)
        two.append([row({"x": 2.0}, 2)])
    with journal.opened(tmp_path) as three:
        assert (three.torn, [r.values["x"] for r in three.rows.values()]) == (False, [0.0, 1.0, 2.0])


def test_a_row_that_went_bad_is_counted_and_takes_no_other_with_it(tmp_path: Path) -> None:
    with journal.opened(tmp_path) as one:
        one.append([row({"x": float(i)}, i) for i in range(3)])
    lines = (tmp_path / journal.FILE).read_bytes().splitlines(keepends=True)
    lines[1] = lines[1].replace(b"toy", b"tox")
    (tmp_path / journal.FILE).write_bytes(b"".join(lines))
    with journal.opened(tmp_path) as two:
        assert (two.torn, two.broken, len(two.rows)) == (False, 1, 2)


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """No file of this process grows beyond `size` bytes: as on a full disk, a write is cut, the next one fails."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_said_and_what_is_there_stays(tmp_path: Path) -> None:
    line = len(journal.encoded(row({"x": 0.0})))
    with journal.opened(tmp_path) as one:
        one.append([row({"x": 0.0}, 0)])
        with files_up_to(line + line // 2), pytest.raises(StudyError, match=os.strerror(errno.EFBIG)) as output:
            one.append([row({"x": 1.0}, 1)])
        assert "1 rows before are kept" in str(output.value)
        assert (tmp_path / journal.FILE).stat().st_size == line
        one.append([row({"x": 2.0}, 2)])
    with journal.opened(tmp_path) as two:
        assert (two.torn, len(two.rows)) == (False, 2)
    with files_up_to(100), pytest.raises(StudyError, match="the journal beside it has every row"):
        table.write(tmp_path / table.FILE, [row({"x": 0.0})])
    assert sorted(f.name for f in tmp_path.iterdir()) == [journal.FILE]


def test_only_one_writes_into_a_folder(tmp_path: Path) -> None:
    with journal.opened(tmp_path), pytest.raises(StudyError, match="another process"), journal.opened(tmp_path):
        pass


@pytest.mark.parametrize(
    "other",
    [
        TrialTask.of("toy", "toy", 4, TASK.parameters, profile="sixth-finger"),
        TrialTask.of("toy", "toy", 3, TASK.parameters | {"force": 1.6}, profile="sixth-finger"),
        TrialTask.of("toy", "toy", 3, {"way": [1, 2], "force": 1.5}, profile="sixth-finger"),
        TrialTask.of("toy", "other", 3, TASK.parameters, profile="sixth-finger"),
        TrialTask.of("other", "toy", 3, TASK.parameters, profile="sixth-finger"),
        TrialTask.of("toy", "toy", 3, TASK.parameters, profile="sixth-finger", text="rate: 100"),
    ],
    ids=["seed", "parameter", "order", "trial", "study", "profile's text"],
)
def test_a_key_changes_with_whatever_the_row_depends_on(other: TrialTask) -> None:
    key = TASK.key(decisive(HERE))
    assert (
        TrialTask.of("toy", "toy", 3, {"force": 1.5, "way": (1, 2)}, profile="sixth-finger").key(decisive(HERE)) == key
    )
    assert other.key(decisive(HERE)) != key
    assert TASK.key(decisive(HERE | {"numpy": "2.1"})) != key
    assert TASK.key(decisive(HERE | {"blas": "openblas SkylakeX"})) == key


def test_differences_are_named_and_the_kernel_isnt_one() -> None:
    assert differences(HERE, HERE | {"blas": "other"}) == []
    assert differences(HERE, {"numpy": "2.1", "program": "abc"}) == ["numpy: 2.1 there, 2.0 here"]
    assert differences(HERE, {"numpy": "2.0"}) == ["program: nothing there, abc here"]


def test_numpys_numbers_become_plain_ones() -> None:
    found = flat({"a": np.float64(0.1), "b": np.int32(3), "c": np.bool_(True), "d": None, "e": "é"})
    assert same(found, {"a": 0.1, "b": 3, "c": True, "d": None, "e": "é"})


@pytest.mark.parametrize(
    "values",
    [{"a": [1]}, {"seed": 1}, {1: 2}, {"a": 2**63}, {"a": "\udcff"}, {"\udcff": 1}, [1.0], {"a": np.zeros(2)}],
    ids=str,
)
def test_what_is_no_flat_row_is_refused(values: Any) -> None:
    with pytest.raises(StudyError):
        flat(values)


def test_parameters_that_a_worker_elsewhere_couldnt_read_are_refused() -> None:
    with pytest.raises(StudyError, match="parameters"):
        TrialTask.of("toy", "toy", 1, {"draw": math.sin})


def test_a_column_has_one_kind_of_value(tmp_path: Path) -> None:
    file = tmp_path / table.FILE
    table.write(file, [row({"x": 1}), row({"x": 0.5}), row({}, state=FAILED)])
    assert [entry["x"] for entry in table.read(file)] == [1.0, 0.5, None]
    for one, other in ((1, "a"), (True, 1.0), (2**53 + 1, 0.5)):
        with pytest.raises(StudyError, match="column x"):
            table.write(file, [row({"x": one}), row({"x": other})])
    file.write_bytes(b"no table")
    with pytest.raises(StudyError, match="can't be read"):
        table.read(file)
