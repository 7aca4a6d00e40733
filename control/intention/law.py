"""The law `intention`: which of a few named actions a person does, from the motion of the whole body.

Linear discriminant analysis on windows of one second (`features`, `discriminant`), with a limit beyond which a motion
is none of those that were learned, and a dwell. Made by `srl calibrate PROFILE intention`. See docs/intention.md.
"""

from __future__ import annotations

from math import isfinite
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from srl.control.intention import record
from srl.control.intention.decision import NONE, Decision
from srl.control.intention.features import FRAME, FRAMES, RATE, features, frame, joints, moved
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

_PERIOD: Final = 1.0 / RATE
_LATE: Final = 4  # looks that a late cycle may miss
_DOWN, _UP = 0.1, 0.02  # s for which a press must have been released, and pressed
_SHARE: Final = 9.99  # a distance that is shown at most


class IntentionConfig(ControllerConfig):
    """Options of `intention`."""

    recogniser: Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE intention`, or name another")] = (
        Field(description="the person's file, beside the profile")
    )
    confidence: float | None = Field(
        None, ge=0.2, le=1.0, description="least posterior of an action that counts; null: the file's"
    )
    dwell: float | None = Field(
        None, ge=0.0, le=10.0, description="s for which an action must be seen before it holds; null: the file's"
    )
    release: float | None = Field(None, ge=0.0, le=10.0, description="s without it before it ends; null: the file's")
    confirm: Literal["hold", "press"] | None = Field(
        None, description="what an action also needs to become active: the person holds still, or a press (`confirm`)"
    )
    still: float = Field(0.06, gt=0.0, le=1.0, description="rad rms, within which each bone holds still for a second")
    press_time: float = Field(2.0, gt=0.0, le=30.0, description="s for which a press confirms the next action")


class Intention(Controller):
    """Recognises actions online.

    Inputs: `rotation` (n, 4) w x y z and `translation` (n, 3) m of the suit's joints in their parents, of which it
    takes those of hips, trunk, arms and legs by name.
    Outputs: `action` (k,), 1 for the one that holds, all 0 for none; `posterior` (k,), how likely each is in the last
    second's motion; `confidence` (1,), the posterior of the most likely class, be it an action or not; `distance` (1,),
    of the motion from that class, as a share of what still belongs to it; `rejected` (1,), 1 where it doesn't.

    An action becomes active once the motion is near enough to it (the file's `trigger`) for `dwell`. With
    `confirm: hold` the last second must have been still, too; with `confirm: press` the input `confirm` (1,) must have
    risen above 0.5 within `press_time`, after 0.1 s below 0.3. One press confirms one action.

    It looks 20 times a second at the last second. Before it has a whole one, nothing is recognised. A sample that isn't
    finite, a cycle that is late by more than 0.2 s, or a pose that is the same to the bit for a second ends what holds,
    and a whole second must come again.
    """

    Config = IntentionConfig
    summary = "which of a person's named actions the whole body does, with confidence and reject"

    def __init__(self, name: str, config: IntentionConfig) -> None:
        super().__init__(name, config)
        file = config.recogniser
        made = record.parse(file.content, str(file.path))
        found = made.discriminant()
        self._record, self._k = made, len(made.actions)
        self._whitening = found.whitening()
        self._means = found.means @ self._whitening.T
        self._limits, self._temperature = found.limits, found.temperature
        self._trigger = [1.0 if each.trigger is None else each.trigger for each in made.classes]
        self._confirm, self._still, self._press_time = config.confirm, config.still, config.press_time
        chosen = {
            key: getattr(made.thresholds, key) if (own := getattr(config, key)) is None else own
            for key in ("confidence", "dwell", "release")
        }
        self._confidence = chosen["confidence"]
        self._decision = Decision(chosen["dwell"], chosen["release"])
        needed = joints(made.trunk)
        self.inputs = (
            Signal(name="rotation", shape=(len(needed), 4), unit="1", labels=needed, components=(QUATERNION,)),
            Signal(name="translation", shape=(len(needed), 3), unit="m", labels=needed, components=(POINT,)),
        )
        if config.confirm == "press":
            self.inputs += (Signal(name="confirm", shape=(1,), unit="1"),)
        self.outputs = (
            Signal(name="action", shape=(self._k,), unit="1", labels=made.actions),
            Signal(name="posterior", shape=(self._k,), unit="1", labels=made.actions),
            Signal(name="confidence", shape=(1,), unit="1"),
            Signal(name="distance", shape=(1,), unit="1"),
            Signal(name="rejected", shape=(1,), unit="1"),
        )
        self._window = np.zeros((FRAMES, FRAME))
        self._clear()

    def _clear(self) -> None:
        self._filled, self._waited = 0, 0.0
        self._released, self._raised, self._pressed = 0.0, 0.0, 0.0
        self._before, self._same = b"", 0
        self._times = np.zeros(self._k, np.intp)
        self._looks = self._rejections = self._gaps = 0

    def reset(self) -> None:
        """Begins anew: nothing holds, and a whole window must come first."""
        self._clear()
        self._nothing()

    def update(self, dt: float) -> None:
        if self._confirm == "press":
            self._press(float(self.input["confirm"][0]), dt)
        rotation, translation = self.input["rotation"], self.input["translation"]
        if not (isfinite(rotation.sum()) and isfinite(translation.sum())):
            self._gap()
            return
        # The first frame is taken at once.
        self._waited = self._waited + dt if self._filled else _PERIOD
        if self._waited < _PERIOD - 1e-9:
            return
        looks = int((self._waited + 1e-9) / _PERIOD)
        if looks > _LATE:  # what the body did meanwhile isn't known
            self._gap()
            looks = 1
        self._waited = max(self._waited - looks * _PERIOD, 0.0)
        # A suit that repeats itself in every bit isn't one that is worn.
        now = rotation.tobytes()
        self._same = self._same + looks if now == self._before else 0
        self._before = now
        if self._same >= FRAMES:
            self._gap()
            return
        newest = frame(rotation.tolist(), translation.tolist())
        if not isfinite(sum(newest)):  # the numbers were too large
            self._gap()
            return
        window = self._window
        window[:-looks] = window[looks:]
        window[-looks:] = newest  # where cycles are longer than frames, it has them all
        self._filled = min(self._filled + looks, FRAMES)
        if self._filled == FRAMES:
            self._look(features(window), looks * _PERIOD)

    def _gap(self) -> None:
        """The body wasn't seen: a whole window must come again."""
        self._gaps += self._filled > 0
        self._filled, self._waited = 0, 0.0
        self._nothing()

    def _press(self, level: float, dt: float) -> None:
        """A press confirms for a while: up for `_UP`, after it was down for `_DOWN`. What is no number is neither."""
        self._pressed = max(self._pressed - dt, 0.0)
        if not isfinite(level):
            self._released = self._raised = 0.0
        elif level > 0.5:
            self._raised += dt
            if self._raised >= _UP - 1e-9 and self._released >= _DOWN - 1e-9:
                self._pressed, self._released = self._press_time, 0.0
            elif self._raised >= _UP - 1e-9:
                self._released = 0.0
        elif level < 0.3:
            self._released, self._raised = self._released + dt, 0.0
        else:
            self._raised = 0.0

    def _look(self, found: Array, since: float) -> None:
        """Takes the newest features, `since` s after those before."""
        away = self._means - self._whitening @ found
        distances = np.einsum("kn,kn->k", away, away)
        best = int(distances.argmin())
        share = float(distances[best] / self._limits[best])
        likely = np.exp((distances[best] - distances) / (2.0 * self._temperature))
        likely /= likely.sum()
        rejected, confidence = share > 1.0, float(likely[best])
        counts = best < self._k and share <= self._trigger[best] and confidence >= self._confidence
        before = self._decision.action
        if self._confirm == "hold" and best != before:
            counts = counts and moved(found) <= self._still
        confirmed = self._confirm != "press" or self._pressed > 0.0
        action = self._decision.next(best if counts else NONE, since, confirmed)
        if action not in (before, NONE):
            self._times[action] += 1
            self._pressed = 0.0
        self._looks += 1
        self._rejections += rejected
        out = self.output
        out["action"][:] = 0.0
        if action != NONE:
            out["action"][action] = 1.0
        out["posterior"][:] = likely[: self._k]
        out["confidence"][0], out["distance"][0], out["rejected"][0] = confidence, min(share, _SHARE), rejected

    def _nothing(self) -> None:
        self._decision.clear()
        self._pressed = 0.0
        for name in ("action", "posterior", "confidence", "distance", "rejected"):
            self.output[name][:] = 0.0

    def metrics(self) -> dict[str, object]:
        """Returns the figures of the run, since the last reset.

        person, date: of the recogniser; actions: how often each began; rejected: share of the looks; gaps: how often
        samples weren't finite.
        """
        return {
            "person": self._record.person,
            "date": self._record.date.isoformat(),
            "actions": dict(zip(self._record.actions, self._times.tolist(), strict=True)),
            "rejected": self._rejections / max(self._looks, 1),
            "gaps": self._gaps,
        }
