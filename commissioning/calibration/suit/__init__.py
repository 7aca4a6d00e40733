"""A capture suit of inertial sensors: its heading, and how fast its segments drift."""
