"""Options that every law about the human-SRL skeleton has."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated

from pydantic import Field, model_validator

from runtime.contracts.controller import ControllerConfig
from runtime.contracts.errors import OptionError, RecordingError
from runtime.contracts.files import FileOption, KeptFile
from runtime.control.models import ArmsOption, named
from runtime.control.skeleton import bvh
from runtime.control.skeleton.human import human
from runtime.control.skeleton.human_srl import HumanSrl


class SkeletonConfig(ControllerConfig):
    """The body and the arms."""

    arms: ArmsOption = named("srl-arms")
    scale: float = Field(1.0, gt=0.3, lt=3, description="of the standard body's end sites; bones are as the suit sends")
    hierarchy: Annotated[KeptFile, FileOption("Name a BVH file, or leave it out")] | None = Field(
        None, description="BVH file whose HIERARCHY is the body, in place of the standard one; its motion isn't used"
    )

    @cached_property
    def figure(self) -> HumanSrl:
        """The skeleton."""
        file = self.hierarchy
        return HumanSrl(
            human(self.scale) if file is None else bvh.parse_tree(file.text, str(file.path)), self.arms.arms
        )

    @model_validator(mode="after")
    def _whole(self) -> SkeletonConfig:
        try:
            assert self.figure is not None
        except RecordingError as error:
            raise OptionError(f"{error.place}: {error.problem}", error.remedy) from None
        except UnicodeDecodeError:
            raise OptionError("the hierarchy is no text", "Give a BVH text file") from None
        return self
