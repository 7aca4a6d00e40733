"""A Franka arm in the simulated cell, with the driver's interface."""

from __future__ import annotations

from typing import Final

from srl.drivers.panda import Panda
from srl.drivers.panda.config import PandaConfig
from srl.drivers.panda.limits import BY_VERSION
from srl.drivers.panda.motion import Motion, Phase
from srl.drivers.panda.packets import RobotMode
from srl.drivers.panda.protocol import Reply, Status
from srl.drivers.panda.requests import Move
from srl.drivers.panda.state import Modes, StateReader
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Stop
from srl.runtime.contracts.world import Fake, World
from srl.sim.devices.panda.robot import TICK, FakePandaConfig, PandaRobot
from srl.sim.devices.shared.windows import inside, lose_while_gone, refuse_while_gone

UNWRITTEN: Final = 3  # number of states without `write` after which the driver ends a motion
_WORDS: Final = {
    RobotMode.USER_STOPPED: "stopped by a person: it goes on at the end of its 'user_stop' window",
    RobotMode.AUTOMATIC_ERROR_RECOVERY: "recovering from errors",
}


class FakePanda(Fake):
    """Runs the driver's own motions, limiter and decoding against the simulated controller, without the wire.

    The robot takes a cycle's command one millisecond later, as on a good network. Milliseconds that the loop itself
    missed don't count as lost packets. A command that is delayed or lost by the fake's options does.

    Attributes:
        robot: the robot itself; a twin uses it, too.
    """

    Options = FakePandaConfig
    real = Panda

    def __init__(self, name: str, config: PandaConfig, world: World, options: FakePandaConfig) -> None:
        super().__init__(name, config, world, options)
        self.robot = PandaRobot(name, world, options)
        self._config, self._options = config, options
        self._reader = StateReader(self.robot.version)
        self._motion = Motion(self.robot.version, config.kind, self._reader)
        self._data = self._tail = b""
        self._forget()

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self._options.loss, self.world.time)
        self._forget()
        robot, known = self.robot, BY_VERSION[self.robot.version]
        self._follow()
        if robot.controller.mode is RobotMode.IDLE:
            for request in self._config.settings():
                status = robot.controller.apply(request)
                if status is not Status.SUCCESS:
                    problem = f"the robot refuses {type(request).__name__}: {status}"
                    raise DeviceError(self.name, problem, "Correct the option in the profile")
        self.limits.update({c.name: known.of(c.kind) for c in self.commands})
        self.health.opened()
        self.health.message = f"simulated {known.name}, FCI protocol {robot.version}"
        self._judge()

    def read(self, now: int) -> None:
        self._check()
        health, robot = self.health, self.robot
        self._fresh, self._heard = True, self.world.time
        steps = self._follow()
        if steps or not self._data:
            self._data = data = robot.write().tobytes()
            self._reader.fill(data, self.state_arrays)
            tail = self._reader.tail(data)
            if tail != self._tail:
                self._tail, self._modes = tail, self._reader.modes(tail)
            self._motion.watch(self._modes, data)
            health.frames += 1
            self._answered = False
            self._unwritten += 1
        if (outcome := robot.controller.take_outcome()) is not None:
            self._reply(outcome)
        self._judge()
        health.stamp = now - self.world.time % TICK
        if self._unwritten > UNWRITTEN:
            self._motion.end()
        if self._motion.phase is Phase.ENDING:
            self._answer()

    def write(self, now: int) -> None:
        self._check()
        if not self.commands:
            return
        self._unwritten = 0
        motion, modes = self._motion, self._modes
        if not self._fresh:  # nothing comes from the robot: it counts the commands that it doesn't get
            self._follow()
            if motion.starve(self.world.time - self._heard):
                self.sent_arrays[self.commands[0].name][:] = motion.values
        self._fresh = False
        if motion.phase is Phase.RUNNING:
            self._answer()
        elif motion.phase is Phase.NONE and modes.mode is RobotMode.IDLE and not modes.errors and not self.health.fault:
            self.robot.forget()
            self._reply(self.robot.controller.move(motion.ask()))

    def stop(self, category: Stop) -> None:
        """Brings the arm to rest in later `read`s; then the robot's own controller holds it."""
        self._motion.end()

    def recover(self, now: int) -> None:
        """Starts automatic error recovery if the robot has errors."""
        self._check()
        if not self.commands:
            return
        self._trouble = ""
        modes = self._modes
        if (modes.mode is RobotMode.REFLEX or modes.errors) and (status := self.robot.controller.recover()) is not None:
            self._trouble = f"automatic error recovery: {status}"
        self._judge()

    def close(self) -> None:
        """Ends the motion at once; the robot holds its position."""
        if self.health.connected:
            self.robot.controller.stop_move()
            self.robot.controller.take_outcome()
        self._motion.abandon()
        self.health.connected = False
        self.health.fault = ""

    def metrics(self) -> dict[str, object]:
        """The robot's name, motions started, reflexes, and commands that the robot missed."""
        controller = self.robot.controller
        return {
            "robot": BY_VERSION[self.robot.version].name,
            "moves": self._motion.started,
            "reflexes": controller.reflexes,
            "lost_commands": controller.reception.total,
        }

    def _forget(self) -> None:
        self._data = self._tail = b""
        self._modes = Modes(0, 0, RobotMode.OTHER, (), ())
        self._answered = True
        self._unwritten = 0
        self._fresh, self._heard = True, self.world.time  # whether, and when (ns), it was read since the last `write`
        self._trouble = ""

    def _follow(self) -> int:
        """Advances the robot's time to the world's; returns the number of its ticks."""
        steps = self.robot.elapsed()
        for step in range(steps):
            self.robot.step(counts=step == 0)
        return steps

    def _answer(self) -> None:
        """Sends the command for the newest state, once."""
        if self._answered or not self._motion.shown(self._modes):
            return
        command = self.commands[0].name
        self.robot.receive(self._motion.packet(self._data, self.command_arrays[command]))
        self.sent_arrays[command][:] = self._motion.values
        self._answered = True

    def _reply(self, status: Status) -> None:
        self._motion.reply(Reply(Move, 0, status))
        self._trouble = self._trouble or self._motion.outcome

    def _judge(self) -> None:
        """Describes in words what keeps the robot from moving."""
        modes = self._modes
        words = _WORDS.get(modes.mode, "")
        if modes.mode is RobotMode.REFLEX:
            words = f"reflex: {', '.join(modes.reasons or modes.errors) or 'no reason given'}"
        if words and self._trouble.startswith("motion "):
            self._trouble = ""  # the robot's own words say better why the motion ended
        if self.commands:
            self.health.fault = ", ".join(filter(None, (words, self._trouble)))

    def _check(self) -> None:
        if self.health.connected and not inside(self._options.loss, self.world.time):
            return
        if self.health.connected:
            self.robot.controller.disconnect()
        lose_while_gone(self, self._options.loss)
