"""Options of a simulated person."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from srl.sim.parts.person.plans import Plan
from srl.sim.wearer.forces import ForceRecording
from srl.sim.world.part import PartConfig


class PersonConfig(PartConfig):
    """Options. With `on` the hand holds that body, at `position` in it (a handle: half its length along z).

    Without `on`, the hand is a free body `<name>/hand` at `position`, and what is mounted on it is its tool.
    The source of each number is in docs/simulated-person.md.
    """

    plan: Plan = Field(default=(), description="what the person does, one step after another")
    recording: ForceRecording | None = Field(default=None, description="forces to replay, instead of a plan")
    tool: str | None = Field(default=None, description="site or body that is led, PART/NAME; null: the hand itself")
    facing: float = Field(default=0.0, description="rad about the world's z, the person's forward direction")
    stiffness: float = Field(default=200.0, gt=0, le=5000, description="N/m of the hand that exerts little force")
    damping: float = Field(default=20.0, ge=0, le=100, description="N s/m, the same; grows as the stiffness' root")
    stiffening: float = Field(
        default=5.0, ge=0, le=50, description="N/m more for each N of force, up to twice as stiff"
    )
    turn_stiffness: float = Field(default=5.0, gt=0, le=50, description="N m/rad")
    turn_damping: float = Field(default=0.3, ge=0, le=2, description="N m s/rad")
    reaction: float = Field(default=0.25, ge=0, le=2, description="s, from an event to the next step")
    sight: float = Field(default=0.12, ge=0, le=1, description="s, delay of what is seen while tracking")
    bandwidth: float = Field(default=1.5, gt=0, le=10, description="Hz, of corrections by sight")
    correction: tuple[float, float] = Field(
        default=(0.5, 1.5), description="of seen errors: at once (1) and by time (1/s); turning gets a third"
    )
    activation: float = Field(default=0.04, ge=0, le=0.5, description="s, lag of the muscles")
    speed: float = Field(default=0.25, gt=0, le=3, description="m/s, greatest of a reaching motion")
    turn_speed: float = Field(default=1.0, gt=0, le=10, description="rad/s, the same")
    tremor: float = Field(default=0.00015, ge=0, le=0.01, description="m, RMS of the free hand along an axis")
    noise: float = Field(default=0.05, ge=0, le=1, description="RMS of the force's noise, as a share of the force")
    noise_floor: float = Field(default=0.0, ge=0, le=5, description="N, RMS of the force's noise without any force")
    drift: float = Field(default=0.002, ge=0, le=0.05, description="m, RMS along an axis, of where things seem")
    aim_bias: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="m, world axes, by which all things seem to be beside where they are"
    )
    aim_tilt: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="rad, rotation vector, world axes, by which directions seem turned"
    )
    steering: float = Field(
        default=0.078, gt=0, le=5, description="s, of the steering law: speed along a path = its play / this"
    )
    reward: float | None = Field(
        default=None, gt=0, description="J, that being there is worth; sets how long a reach takes; null: `speed` does"
    )
    arm_mass: float = Field(default=2.2, gt=0, description="kg, of the arm as the hand moves it, for the effort")
    push_rise: float = Field(default=0.0, ge=0, description="N/s, by which a push that is stalled grows")
    push_most: float = Field(default=40.0, gt=0, description="N, of a push that has grown")
    strength: float = Field(default=150.0, gt=0, description="N, the hand's greatest force when fresh")
    turn_strength: float = Field(default=8.0, gt=0, description="N m")
    fatigue: bool = Field(
        default=False, description="strength wanes with work; without enough of it plans are given up"
    )
    arm_load: float = Field(default=10.0, ge=0, description="N at the hand that holding up the arm itself takes")
    hand_mass: float = Field(default=1.0, gt=0, description="kg of a free hand; the arm holds its weight")
    knowledge: float = Field(
        default=1.0, ge=0, le=2, description="share that the person knows of a handle's mass, damping and inertia"
    )
    learned_mass: float | None = Field(
        default=None, ge=0, description="kg of the tool as the person knows it; null: 6 on a handle, else the tool's"
    )
    learned_damping: float | None = Field(
        default=None, ge=0, description="N s/m of the same; null: 40 on a handle, else 0"
    )
    learned_inertia: float | None = Field(
        default=None, ge=0, description="kg m2 about the tool, likewise; null: 1 on a handle, else 0"
    )
    learned_turn_damping: float | None = Field(
        default=None, ge=0, description="N m s/rad of the same; null: 1.8 on a handle, else 0"
    )

    @model_validator(mode="after")
    def _one(self) -> Self:
        if self.plan and self.recording is not None:
            raise ValueError("give a 'plan' or a 'recording', not both")
        return self
