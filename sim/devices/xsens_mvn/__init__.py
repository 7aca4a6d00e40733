"""A simulated Xsens suit and MVN."""
