"""The extension takes only arrays that fit, holds on to them, and Python computes where it isn't there."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.compiled import needs_c
from helpers.control import bound
from helpers.superman import MOUNT

from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.runtime.contracts import compiled as module
from srl.runtime.contracts.compiled import NotCompiledError, bind, compiled
from srl.runtime.contracts.errors import WiringError
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.service.fitness import processor


def frozen(size: int) -> Any:
    array = np.zeros(size)
    array.flags.writeable = False
    return array


@needs_c
@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        (([0.0], np.zeros(1), np.zeros(1)), "bytes-like"),
        ((np.zeros(3, np.float32), np.zeros(3), np.zeros(3)), "float64"),
        ((np.zeros(3, np.int64), np.zeros(3), np.zeros(3)), "float64"),
        ((np.zeros(3), np.zeros(3), np.zeros(4)), "4 elements instead of 3"),
        ((np.zeros(3), np.zeros((3, 2))[:, 0], np.zeros(3)), "contiguous"),
        ((np.zeros(3), np.zeros(3), frozen(3)), "(?i)read.?only|writable"),
        ((np.zeros(17), np.zeros(17), np.zeros(17)), "17 joints"),
        ((np.zeros(0), np.zeros(0), np.zeros(0)), "0 joints"),
        ((np.zeros(3), np.zeros(3)), "takes 3 arrays"),
        ((np.zeros(3).astype(">f8"), np.zeros(3), np.zeros(3)), "float64"),
        ((np.frombuffer(bytearray(25), np.float64, 3, 1), np.zeros(3), np.zeros(3)), "float64|aligned"),
    ],
)
def test_what_does_not_fit_is_refused(arrays: Any, said: str) -> None:
    with pytest.raises(NotCompiledError, match=said):
        bind("sent-tracker", *arrays)


@needs_c
def test_it_is_told_only_of_what_it_knows() -> None:
    with pytest.raises(NotCompiledError, match="older than 'nobody'"):  # as of an extension that wasn't built anew
        bind("nobody")
    with pytest.raises(TypeError):
        module.extension.bind()
    step = bind("sent-tracker", np.zeros(1), np.zeros(1), np.zeros(1))
    for wrong in ((), ("x",), (1.0, 0, 0)):
        with pytest.raises(TypeError):
            step(*wrong)


@needs_c
def test_a_time_that_can_not_be_is_for_python() -> None:
    applied, kept = np.ones(2), np.zeros(2)
    step = bind("sent-tracker", applied, applied, kept)
    assert [step(dt) for dt in (np.nan, -1e-3, np.inf, 2.0)] == [-1] * 4
    assert not kept.any()
    assert step(1e-3) == 0
    assert kept.tolist() == [1.0, 1.0]


@pytest.mark.slow
@needs_c
def test_bound_arrays_live_as_long_as_what_is_bound_to_them() -> None:
    applied, kept = np.ones(2), np.zeros(2)
    gone = weakref.ref(applied)
    step = bind("sent-tracker", applied, applied, kept)
    with pytest.raises(ValueError, match=r"resize|reference"):
        kept.resize(100_000)
    del applied
    gc.collect()
    assert gone() is not None
    assert step(1e-3) == 0
    del step
    gc.collect()
    assert gone() is None


def made() -> ToolPose:
    return bound(ToolPose("tool", ToolPoseConfig()), mount=MOUNT)


def test_a_law_without_the_extension_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "extension", None)
    monkeypatch.setattr(module, "_missing", "not here")
    with pytest.raises(NotCompiledError, match="not here"):
        compiled(made())
    assert module.available() == "python"


def test_a_derived_law_is_not_taken_for_the_law_it_is_derived_from() -> None:
    class Own(ToolPose):
        def update(self, dt: float) -> None:
            super().update(dt)
            self.output["pose"][0] += 1.0

    with pytest.raises(NotCompiledError, match="no C version"):
        compiled(bound(Own("tool", ToolPoseConfig()), mount=MOUNT))


def graph(*overrides: str) -> Any:
    checked, source = profile.load("sixth-finger", overrides)
    return wiring.build(checked, source, [])


def test_c_alone_is_refused_where_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "extension", None)
    monkeypatch.setattr(module, "_missing", "the laws in C aren't installed: no compiler")
    with pytest.raises(WiringError, match="aren't installed") as refused:
        Lockstep(graph("backend=c"))
    assert "compiler" in refused.value.remedy
    found = Lockstep(graph()).graph.layout.meta["backend"]
    assert (found["wanted"], found["computed"]) == ("auto", "python")
    assert found["guards"] == {"finger.position_command": "python: the laws in C aren't installed: no compiler"}
    finding = processor.laws()  # of `srl doctor`
    assert (finding.verdict, finding.found) == ("doubtful", "the laws in C aren't installed: no compiler")


@needs_c
def test_a_recording_names_what_computes_each_law_and_guard() -> None:
    found = Lockstep(graph()).graph.layout.meta["backend"]
    assert (found["wanted"], found["computed"]) == ("auto", module.available())
    assert module.available().startswith("c, ")
    assert found["guards"] == {"finger.position_command": "c"}
    python = Lockstep(graph("backend=python")).graph.layout.meta["backend"]
    assert (python["computed"], python["laws"]["hand"]) == ("python", "python: the profile's choice")


@needs_c
def test_a_file_that_is_cut_off_or_another_copys_isnt_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut off at a page's end it ended the process (SIGBUS); another copy's is what an editable install finds."""
    whole = Path(module.extension.__file__).read_bytes()
    copy = tmp_path / "_compiled.abi3.so"
    copy.write_bytes(whole)
    assert module.unfit(copy, tmp_path) == ""
    assert "of another copy of the package" in module.unfit(copy)
    for size in (1000, 4096, 8192, len(whole) - 1):
        copy.write_bytes(whole[:size])
        assert "is cut off" in module.unfit(copy, tmp_path)
    for short in (b"", b"#!/bin/sh\n", whole[:20]):
        copy.write_bytes(short)
        assert module.unfit(copy, tmp_path) == ""  # the loader says what it is
    monkeypatch.setattr(module, "find_spec", lambda name: SimpleNamespace(origin=str(copy)))
    found, why, old = module._load()
    assert (found, old) == (None, True)
    assert str(tmp_path) in why
