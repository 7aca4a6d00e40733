"""A simulated camera that sees a simulated hand."""
