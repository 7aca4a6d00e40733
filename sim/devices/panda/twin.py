"""The twin of a Panda: a simulated Franka robot that speaks FCI, protocol 5 or 10, on loopback.

It covers sections 2 to 8 of the protocol sheet franka-fci. Not simulated: Cartesian generators and Cartesian
impedance (NOT_POSSIBLE), guiding, virtual walls, self-collision, path and goal deviations, filters, the
accelerometers, the FR3's safety functions, the gripper. Public sources leave the following open; the twin chooses:

- A motion's first packet has 500 ms before lost packets count. A packet that doesn't answer the newest state is
  lost.
- A reflex watches the external torques and forces (first-order filter, 50 Hz) only while a motion runs.
- A measured velocity may exceed its limit by 5 % of the greatest velocity, a measured position by 0.01 rad.
- For setpoints that end a motion, only the flag is read. The robot then brakes any remaining motion.
- A client that disconnects during a motion leaves a reflex (communication constraints) that the next client must
  clear.
- Automatic recovery takes 20 ms; outside the joints' limits a person must do it.
- Setters are accepted in idle mode only. A second client is rejected.
"""

from __future__ import annotations

from collections import Counter

from srl.sim.devices.panda.fake import FakePanda
from srl.sim.devices.panda.robot import Heard
from srl.sim.devices.panda.twin_requests import Session
from srl.sim.devices.shared.sockets import Client, SocketTwin, TcpDoor, UdpDoor


class PandaTwin(SocketTwin):
    """Takes commands over TCP from one client, and sends it states by UDP from the socket that takes its setpoints.

    The robot advances by one millisecond in each `service` call in which the world did. Milliseconds that the twin
    itself missed (the machine was busy) send no state and don't count as lost packets; the motion stands still.

    In lockstep (the fake's option), each state of a motion waits for the answer to the previous one. `waiting` reports
    this; a caller that steps the world pauses it meanwhile. If a client doesn't answer for longer than `patience`, it
    loses a packet at each further millisecond, until it answers again.

    Attributes:
        states: number of states sent. setpoints: number taken. wrong: datagrams that are no command. late: those that
            answer an older state than the newest.
    """

    def __init__(self, fake: FakePanda) -> None:
        super().__init__(fake)
        self.robot = fake.robot
        options = fake.robot.options
        self.commands, self.datagrams = TcpDoor(options.host, most=1), UdpDoor(options.host)
        self.states = self.setpoints = self.wrong = self.late = 0
        self._lockstep, self._patience = options.lockstep, round(options.patience * 1e9)
        self._client: Client | None = None
        self._session: Session | None = None
        self._seen: Counter[str] = Counter()
        self._answered = True  # whether the newest state of a motion was answered
        self._sent_at = 0
        self._silent = False  # whether the client has exceeded `patience`

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self.commands, self.datagrams]

    def open(self) -> None:
        if not self.commands.port:
            self.commands.open(self.robot.options.port)
        super().open()

    def close(self) -> None:
        self._leave()
        super().close()

    def waiting(self, now: int) -> bool:
        """Whether, in lockstep, the robot waits for an answer; its time then stands still."""
        if not self._lockstep or self._answered or not self.robot.controller.wait():
            return False
        return not self._silent and now - self._sent_at < self._patience

    def service(self, now: int) -> None:
        super().service(now)
        if not self.commands.is_open or self.muted:
            self._go_on()  # the robot continues without its network

    def work(self, now: int) -> None:
        self._talk()
        self._listen()
        if self.waiting(now):
            self.robot.elapsed()  # discards this time, in which the robot stood still
            return
        if self._lockstep:
            self._silent = not self._answered and self.robot.controller.wait()
        if not self._go_on():
            return
        client, session = self._client, self._session
        if client is None or session is None:
            return
        if answers := session.due():
            client.write(answers, keep=True)
        if session.udp_port is None:
            return
        self.datagrams.write(self.robot.write().tobytes(), (client.peer[0], session.udp_port))
        self.states += 1
        self._answered, self._sent_at = False, now

    def metrics(self) -> dict[str, object]:
        """Adds to the socket twin's figures: numbers of datagrams and requests, and the robot's condition.

        Datagrams: states sent, setpoints taken, datagrams refused. Requests are counted by kind. Condition: the robot's
        mode, its errors, packets lost and reflexes.
        """
        controller = self.robot.controller
        return super().metrics() | {
            "states": self.states,
            "setpoints": self.setpoints,
            "wrong_datagrams": self.wrong,
            "late_setpoints": self.late,
            "requests": dict(self._seen),
            "mode": controller.mode.name.lower(),
            "errors": list(controller.names),
            "packets_lost": controller.reception.total,
            "reflexes": controller.reflexes,
        }

    def _go_on(self) -> bool:
        """Advances the robot's time to the world's; returns False if it stood still."""
        elapsed = self.robot.elapsed()
        for missed in range(min(elapsed, 1) if self._lockstep else elapsed):
            self.robot.step(counts=missed == 0)
        return elapsed > 0

    def _talk(self) -> None:
        """Serves the command channel."""
        for new in self.commands.accept():
            self._client, self._session = new, Session(self.robot, self._seen)
        client, session = self._client, self._session
        if client is None or session is None:
            return
        if answers := session.receive(client.read()):
            client.write(answers, keep=True)
        else:
            client.write(b"")  # sends the rest of a long answer
        if session.refused and not client.unsent():
            client.close()
        if client.gone:
            self._leave()

    def _listen(self) -> None:
        """Takes setpoints, the newest last."""
        for data, _ in self.datagrams.read():
            heard = self.robot.receive(data)
            self.wrong += heard is Heard.WRONG
            self.late += heard is Heard.LATE
            if heard is Heard.TAKEN:
                self.setpoints += 1
                self._answered = True
            if heard in (Heard.TAKEN, Heard.LATE):
                self._silent = False

    def _leave(self) -> None:
        """Disconnects the client."""
        client, self._client = self._client, None
        if self._session is not None:
            self._session.close()
        self._session = None
        if client is not None:
            client.close()
            self.robot.forget()
            self.robot.controller.disconnect()
