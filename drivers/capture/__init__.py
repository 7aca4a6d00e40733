"""What the drivers of motion capture systems share: wanted names, the states, axes, and the order of numbers."""
