"""Laws for an arm that a lab built itself, known by its description (`robot:`)."""
