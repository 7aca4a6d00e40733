"""Measurements against peers and limits, as ratios within one run: the host's noise hits both sides alike."""
