"""Settings for every test: hypothesis without deadlines, as the machine may be slow at any instant."""

from hypothesis import settings

settings.register_profile("srl", deadline=None, derandomize=True)
settings.load_profile("srl")
