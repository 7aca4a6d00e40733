"""Recognisers of intentions from data sets of several people."""
