"""The panel: a page in the browser, served on 127.0.0.1 by a process beside the loop: the participant's screen."""
