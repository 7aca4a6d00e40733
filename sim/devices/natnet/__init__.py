"""A simulated OptiTrack system."""
