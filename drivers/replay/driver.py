"""Replays a recorded device in place of the real one: same signals, same intervals, same ages.

A recording is srl's own, or a motion file of a capture system (`srl.drivers.replay.motion_file`).
"""

from __future__ import annotations

from srl.drivers.replay import motion_file
from srl.drivers.replay.config import OPTIONS, ReplayConfig
from srl.drivers.replay.track import load
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Array


class Player:
    """Plays a track on a clock that begins at the first call of `play`.

    Attributes:
        signals: the device's states.
        stamp: ns of that clock, when the newest sample was taken; -1 before the first.
        frames: samples so far.
        over: whether the end was reached with `at_end: lose`.
    """

    def __init__(self, config: ReplayConfig, place: str) -> None:
        """Reads the recording. Raises RecordingError, HostError."""
        if config.recording.suffix.lower() in OPTIONS:
            self._track = motion_file.samples(config)
        else:
            self._track = load(str(config.recording), config.device, config.start)
        self._at_end, self._place = config.at_end, place
        self._started: int | None = None
        self._last = -1  # number of the newest sample; keeps counting when the track is repeated
        self.signals = self._track.signals
        self.stamp = -1
        self.frames = 0
        self.over = False

    @property
    def duration(self) -> float:
        """s, from the first sample to when it would begin anew."""
        return self._track.length * 1e-9

    def rewind(self) -> None:
        """Begins again at the next call of `play`. Raises DeviceError if the recording is over."""
        if self.over:
            raise DeviceError(self._place, "the recording is over", "Set `at_end: loop` to repeat it")
        self._started, self._last = None, -1

    def play(self, now: int) -> list[Array] | None:
        """Returns the newest values by signal; None if there are no newer ones than last time.

        Raises:
            DeviceLostError: the recording is over, with `at_end: lose`.
        """
        if self._started is None:
            self._started = now
        track, elapsed, rounds = self._track, now - self._started, 0
        if self._at_end == "loop":
            rounds, elapsed = divmod(elapsed, track.length)
        elif elapsed >= track.length and self._at_end == "lose":
            self.over = True
            raise DeviceLostError(self._place, "the recording is over", "Set `at_end` to hold or loop")
        number = track.find(elapsed)
        if number < 0:  # the clock went back to before the beginning
            return None
        count = rounds * len(track) + number
        if elapsed >= track.length:
            self.stamp = now  # `at_end: hold`: the sample counts as new, as requested
        else:
            self.stamp = self._started + rounds * track.length + int(track.arrived[number] - track.age[number])
        if count == self._last:
            return None
        self.frames += max(count - self._last, 1)
        self._last = count
        return track.values(number)


class Replay(Sensor):
    """A recorded device. Its states are those in the recording.

    The recording is read with the profile, because it determines the signals. The first sample comes at once after
    `open`, the others at the recorded intervals, each with its recorded age. While the recorded device was silent or
    gone, this one is silent.
    """

    Config = ReplayConfig
    summary = "a recorded device: its samples again, in the place of any device that gives the same"
    gives = ("<signal>",)
    max_age = 0.3
    here = False

    def __init__(self, name: str, config: ReplayConfig) -> None:
        super().__init__(name, config)
        self._player = Player(config, name)
        self.states = self._player.signals

    @property
    def duration(self) -> float:
        """s that the recording lasts."""
        return self._player.duration

    def open(self) -> None:
        """Raises DeviceError if the recording is over."""
        self.close()
        self._player.rewind()
        self.health.opened()

    def read(self, now: int) -> None:
        if not self.health.connected:
            raise DeviceLostError(self.name, "it isn't open", "Open it first")
        try:
            values = self._player.play(now)
        except DeviceLostError:
            self.health.connected = False
            raise
        self.health.stamp, self.health.frames = self._player.stamp, self._player.frames
        if values is not None:
            for signal, array in zip(self.states, values, strict=True):
                self.state_arrays[signal.name][...] = array

    def close(self) -> None:
        self.health.connected = False
