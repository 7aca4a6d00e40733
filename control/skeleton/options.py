"""Options that every law and clearance about the human-SRL skeleton has."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from srl.control.skeleton.envelope import CLOTHING, LINK_RADIUS, Envelope, reaches
from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import OptionError, RecordingError
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import ArmsOption, named
from srl.runtime.models.skeleton import bvh
from srl.runtime.models.skeleton.arms import Side

Radius = Annotated[float, Field(ge=0.005, le=1, allow_inf_nan=False)]  # m: a thinner body part or link is a mistake


class FigureOptions(Options):
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
    def _whole(self) -> Self:
        try:
            assert self.figure is not None
        except RecordingError as error:
            raise OptionError(f"{error.place}: {error.problem}", error.remedy) from None
        except UnicodeDecodeError:
            raise OptionError("the hierarchy is no text", "Give a BVH text file") from None
        return self


class SkeletonConfig(FigureOptions, ControllerConfig):
    """Options of a law."""


class EnvelopeOptions(FigureOptions):
    """What the envelope of body and arm is made of."""

    side: Side | None = Field(None, description="the arm; needed where `arms` has two")
    radii: dict[str, Radius] = Field(
        default_factory=dict, description="m, by segment, as measured on the wearer with clothes: right_forearm, thigh"
    )
    clothing: float = Field(CLOTHING, ge=0, lt=0.2, description="m, on all other segments")
    link_radius: float = Field(LINK_RADIUS, ge=0.01, lt=0.5, description="m, of the arm's links")
    stroke: float = Field(0.2, ge=0.01, lt=1, description="m, that a sliding joint moves at most")
    base_shift: float = Field(
        0.0, ge=0, lt=0.3, description="m, that the arm's base may be beside where it is worn: what straps give"
    )
    base_turn: float = Field(
        0.0,
        ge=0,
        lt=0.5,
        description="rad, by which the base may be turned, about any axis; counts by each link's reach",
    )
    leave_out: tuple[tuple[str, str], ...] = Field((), description="pairs [link, segment] that aren't compared")

    @cached_property
    def arm(self) -> Side:
        """Which of the arms it is about. Raises OptionError."""
        return self.arms.arms.side(self.side)

    @cached_property
    def envelope(self) -> Envelope:
        """The capsules. Raises OptionError."""
        arms = self.arms.arms
        return Envelope(self.figure.tree, arms, self.arm, self.radii, self.clothing, self.link_radius, self.leave_out)

    @cached_property
    def beside(self) -> Array:
        """(n + 1,) m: by how much each link may be beside where it is said to be, by what the base gives."""
        arms = self.arms.arms
        stroke = np.full(arms.n, self.stroke)
        far = reaches(arms, self.arm, -stroke, stroke).max(axis=0) + np.linalg.norm(arms.offsets(self.arm)[1])
        made: Array = self.base_shift + self.base_turn * far
        return made

    @model_validator(mode="after")
    def _fits(self) -> Self:
        assert self.envelope is not None
        return self
