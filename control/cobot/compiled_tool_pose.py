"""`tool-pose` in C (native/tool_pose.c)."""

from __future__ import annotations

from srl.control.cobot.tool_pose import ToolPose
from srl.control.shared.compiled_chain import joint_places, place_of
from srl.runtime.contracts import rotation
from srl.runtime.contracts.compiled import Compiled, Step, bind, numbers
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model


class CompiledToolPose(Compiled):
    """It has no state."""

    law: ToolPose

    def _bind(self) -> Step:
        law = self.law
        model = pinocchio_model(law._robot)
        flange = numbers(place_of(model.frames[model.getFrameId(FLANGE)].placement))
        end = rotation.homogeneous(law.transform["tool"])
        mount = rotation.homogeneous(law.transform["mount"])
        R, p = flange[:9].reshape(3, 3), flange[9:]
        tool = numbers(R @ end[:3, :3], R @ end[:3, 3] + p)
        i, o = law.input, law.output
        return bind(
            "tool-pose", i["q"], i["qd"], i["base_pose"], i["base_twist"], numbers(mount[:3, :3], mount[:3, 3]),
            joint_places(model), tool, o["pose"], o["twist"], o["jacobian"],
        )  # fmt: skip
