"""A simulated board that sends numbers over a serial line."""
