"""The demonstration of a task for independent operation."""
