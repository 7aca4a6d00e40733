"""The law `reach`: goals of a worn arm, round the body that wears it."""
