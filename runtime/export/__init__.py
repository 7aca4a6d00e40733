"""Writes recordings as files of other programs: MCAP, Parquet, C3D, BIDS-Motion."""
