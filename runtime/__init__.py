"""The SRL runtime: contracts, loop, guard, telemetry and command line."""

__version__ = "0.1.0"
