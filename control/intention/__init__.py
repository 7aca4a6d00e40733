"""Intention from the motion of the whole body: which of a few named actions the person does."""
