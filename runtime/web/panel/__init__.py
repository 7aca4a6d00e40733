"""Pages in the browser, served on 127.0.0.1 beside the loop: the live picture, the participant's screen."""
