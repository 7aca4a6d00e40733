"""The training of a person's recogniser of intentions."""
