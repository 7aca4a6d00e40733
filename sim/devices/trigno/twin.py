"""The Trigno SDK server as a twin: greeting, commands, and the EMG port (sheet delsys_trigno)."""

from __future__ import annotations

from typing import Final

from srl.drivers.trigno.protocol import END, SLOTS, encode
from srl.sim.devices.shared.sockets import Client, SocketTwin, TcpDoor, UdpDoor
from srl.sim.devices.trigno.fake import FakeTrigno

BANNER: Final = b"Delsys Trigno System Digital Protocol Version 3.6.0 " + END
_CATCH_UP: Final = 75  # most frames sent at once: the number that a server stores for a second
_FIXED: Final = {
    "MASTER": "NEW MASTER", "MASTER?": "YES", "VERSION?": "3.6.0", "FRAME INTERVAL?": "0.0135",
    "MAX SAMPLES AUX?": "2", "BASE FIRMWARE?": "1.0", "BASE SERIAL?": "SP-B00-0001",
    "TRIGGER?": "START OFF STOP OFF",
}  # fmt: skip
_SWITCHES: Final = {
    "ENDIAN LITTLE": ("big", False), "ENDIAN BIG": ("big", True),
    "UPSAMPLE ON": ("upsample", True), "UPSAMPLE OFF": ("upsample", False),
    "BACKWARDS COMPATIBILITY ON": ("classic", True), "BACKWARDS COMPATIBILITY OFF": ("classic", False),
    "TRIGGER START OFF": ("trigger", False), "TRIGGER STOP OFF": ("trigger", False),
}  # fmt: skip


class TrignoTwin(SocketTwin):
    """Serves one master at a time; samples go to every client of the EMG ports, the old one (+1) and the new one (+3).

    Every sensor is upsampled to 2000 Hz whatever UPSAMPLE says: without it, a real one sends 26 samples a frame.
    """

    def __init__(self, fake: FakeTrigno) -> None:
        super().__init__(fake)
        self.station = fake
        self.control, self.emg, self.legacy = TcpDoor(most=2), TcpDoor(), TcpDoor()
        self.running = False
        self.commands: dict[str, int] = {}
        self._settings = {"big": False, "upsample": True, "classic": False, "trigger": False}
        self._rest: dict[Client, bytes] = {}
        self._sent = -1

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self.control, self.emg, self.legacy]

    def describe(self) -> str:
        return f"{self.control.address}?emg={self.emg.port}"

    def opened(self) -> None:
        self.running = False
        self._rest = {}

    def work(self, now: int) -> None:
        for client in self.control.accept():
            client.write(BANNER)
        for door in (self.emg, self.legacy):
            door.accept()
            for client in door.clients:
                client.read()
        for client in self.control.clients:
            *asked, rest = (self._rest.pop(client, b"") + client.read()).split(b"\r\n")
            for text in asked:
                if text:  # one packet may contain several commands, one line each, followed by an empty line
                    client.write(self._answer(text.decode("ascii", "replace").strip(), client) + END, keep=True)
            if not client.gone:
                self._rest[client] = rest[-256:]
        if not self.control.clients:
            self.running = False
        self._stream()

    def metrics(self) -> dict[str, object]:
        """Adds to the socket twin's figures: the commands by text."""
        return super().metrics() | {"commands": dict(self.commands)}

    def _stream(self) -> None:
        newest = self.station.newest()
        first = max(self._sent + 1, newest + 1 - _CATCH_UP, 0)
        self._sent = max(newest, -1)
        if not self.running:
            return
        for number in range(first, newest + 1):
            frame = self.station.frame(number)
            if frame is None:
                continue
            data = encode(frame, little=not self._settings["big"])
            for client in (*self.emg.clients, *self.legacy.clients):
                client.write(data)

    def _answer(self, text: str, client: Client) -> bytes:
        self.commands[text] = self.commands.get(text, 0) + 1
        if text in _FIXED:
            return _FIXED[text].encode()
        if text in _SWITCHES:
            if self.running:
                return b"CANNOT COMPLETE"
            name, value = _SWITCHES[text]
            self._settings[name] = value
            return b"OK"
        if text == "START":
            # A client may have connected, and sent START, since this cycle looked for new ones.
            for door in (self.emg, self.legacy):
                door.accept()
            if not (self.emg.clients or self.legacy.clients):
                return b"CANNOT COMPLETE"
            # The count of samples begins with the next frame.
            self.running, self._sent = True, self.station.newest()
            return b"OK"
        if text == "STOP":
            self.running = False
            return b"OK"
        if text == "QUIT":
            self.running = False
            return b"BYE"
        asked = {"ENDIANNESS?": ("BIG", "LITTLE", "big"), "BACKWARDS COMPATIBILITY?": ("YES", "NO", "classic"),
                 "UPSAMPLING?": ("UPSAMPLING ON", "UPSAMPLING OFF", "upsample"),
                 "MAX SAMPLES EMG?": ("27", "26", "upsample")}  # fmt: skip
        if text in asked:
            yes, no, name = asked[text]
            return (yes if self._settings[name] else no).encode()
        return self._sensor(text.split()).encode()

    def _sensor(self, words: list[str]) -> str:
        if len(words) < 3 or words[0] != "SENSOR" or not words[1].isdigit() or not 1 <= int(words[1]) <= SLOTS:
            return "INVALID COMMAND"
        sensor, what = int(words[1]), " ".join(words[2:])
        on = sensor in self.station.channels.values()
        if what in ("PAIRED?", "ACTIVE?"):
            return "YES" if on else "NO"
        answers = {
            "TYPE?": "D", "SERIAL?": f"SP-W02C-{1700 + sensor}", "FIRMWARE?": "1.0", "MODE?": "40",
            "CHANNELCOUNT?": "1", "EMGCHANNELCOUNT?": "1", "AUXCHANNELCOUNT?": "0", "STARTINDEX?": str(sensor),
            "CHANNEL 1 RATE?": "2000", "CHANNEL 1 SAMPLES?": "27", "CHANNEL 1 UNITS?": "V", "CHANNEL 1 GAIN?": "300",
            "RANGE?": "HIGH", "BANDWIDTH?": "WIDE",
        }  # fmt: skip
        if what in answers:
            return answers[what] if on else "CANNOT COMPLETE"
        if words[2] == "SETMODE" and len(words) == 4 and words[3].isdigit():
            return "CANNOT COMPLETE" if self.running or not on else f"SENSOR {sensor} SET TO MODE {words[3]}"
        return "INVALID COMMAND"
