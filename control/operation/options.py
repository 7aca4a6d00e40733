"""Options of the law `independent-operation`."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from srl.control.operation import record
from srl.control.operation.demonstration import Thresholds
from srl.control.operation.replay import ReplayOptions
from srl.control.reach.options import MarginOptions
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.per_element import Finite
from srl.runtime.models import record_file

_TaskFile = Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE independent-operation`")]
_Far = Annotated[float, Field(ge=-2.0, le=2.0)]


class IntentionOption(Options):
    """The person's actions that start and pause the task, by their names in the law `intention`."""

    run: str = Field(description="the action that starts or resumes it")
    pause: str = Field(description="the action that pauses it")

    @model_validator(mode="after")
    def _differ(self) -> Self:
        if self.run == self.pause:
            raise OptionError("one action can't start and pause it", "Name two actions")
        return self


class IndependentOperationConfig(MarginOptions, ControllerConfig):
    """Options of `independent-operation`. Those of the margin count with `around: plan`."""

    renamed: ClassVar[dict[str, str]] = {"patience": "timeout"}

    task: _TaskFile | None = Field(
        None, description="the file of a task, beside the profile; without it there is one once it is taught"
    )
    hand: str = Field("RightHand", description="the node of the body that shows a task")
    shift: tuple[_Far, _Far, _Far] = Field(
        (0.0, 0.0, 0.0), description="m, from where the hand was to where the arm does it, in its carrier's frame"
    )
    button: bool = Field(True, description="input `press`: each press runs the task, or pauses it")
    intention: IntentionOption | None = Field(None, description="input `action`: named actions run and pause it")
    teach: bool = Field(False, description="input `teach`: while it is 1, the hand shows a task")
    repeats: int | None = Field(1, ge=1, description="how often a start does the task; null: until it is paused")
    posture: dict[str, Finite] | None = Field(
        None, description="rad or m, of each joint: where it goes as far as the task lets it; null: mid-range"
    )
    timeout: float = Field(0.1, ge=0.0, lt=2.0, description="s without body, button or position before they are lost")
    replay: ReplayOptions = ReplayOptions()
    thresholds: Thresholds = Thresholds()
    frame: str | None = Field(None, description="frame of the profile's tree that the suit's world is")

    @cached_property
    def shown(self) -> record.TaskRecord | None:
        """What the file holds. Raises OptionError."""
        if self.task is None:
            return None
        try:
            found = record_file.parse(record.TaskRecord, self.task.content, str(self.task.path))
        except record_file.RecordError as error:
            raise OptionError(f"{error.place}: {error.problem}", error.remedy) from None
        if found.frame != self.arms.arms.parent:
            problem = f"the task is in the frame of '{found.frame}', and the arms hang on '{self.arms.arms.parent}'"
            raise OptionError(problem, "Show the task again with these arms")
        return found

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.hand not in self.figure.tree.names:
            raise OptionError(f"the body has no node '{self.hand}'", nearest(self.hand, self.figure.tree.names))
        if not (self.button or self.intention):
            raise OptionError("nothing could start the task", "Set `button: true`, or give `intention:`")
        if self.shown is None and not self.teach:
            raise OptionError("there is no task and none can be taught", "Give `task:`, or set `teach: true`")
        return self
