"""What a participant is shown in the browser, and a trial on that screen (docs/participant-screen.md)."""

from srl.runtime.web.panel.screen import Screen
from srl.runtime.web.panel.trial import Trial

__all__ = ["Screen", "Trial"]
