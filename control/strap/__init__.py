"""Compensation, at the tip of a worn arm, of a base that gives way."""
